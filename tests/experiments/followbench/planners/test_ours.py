"""Our planner: it keeps its place, and gets out of the way of people."""

from __future__ import annotations

import math

import numpy as np
import pytest
from experiments.followbench.planners.views import SIZE, drive, view
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.episodes import Density
from mecazen_experiments.followbench.generate import generate
from mecazen_experiments.followbench.planners.ours import Ours
from mecazen_experiments.followbench.play import play
from mecazen_experiments.followbench.unicycle import Unicycle, gaps, touches
from mecazen_experiments.followbench.view import Place, Seen


@pytest.mark.parametrize("place", ["back", "left_side"])
def test_it_takes_its_place_by_a_walker(place: Place) -> None:
    states = drive(Ours(), view(target=Seen(53.0, 50.5, 1.2, 0.0), place=place), 150)
    x, y = 53.0 + 1.2 * 15.0 - states[-1].pose.x, 50.5 - states[-1].pose.y
    assert math.hypot(x, y) == pytest.approx(1.5, abs=0.3)
    if place == "left_side":
        assert abs(y) > 1.2


@pytest.mark.parametrize("degrees", range(0, 360, 45))
def test_it_gets_out_of_the_way_of_a_person_who_gives_no_way(degrees: int) -> None:
    angle = math.radians(degrees)
    c, s = math.cos(angle), math.sin(angle)
    person = Seen(50.0 + 4.0 * c, 50.0 + 4.0 * s, -1.5 * c, -1.5 * s)
    first = view(Pose2D(50.0, 50.0, 0.3), Seen(51.0, 51.5, 0.0, 0.0), [person])
    for k, state in enumerate(drive(Ours(), first, 60)[1:]):
        # contacts count after the robot's move, before that of people
        x, y, vx, vy = person
        place = np.array([(x + 0.1 * k * vx, y + 0.1 * k * vy), first.target[:2]])
        assert gaps(state.pose, place).min() > 0.0


def test_it_does_not_run_into_a_wall_between_it_and_the_target() -> None:
    wall = (51.5, 50.0, 0.0, 0.3, 2.0)
    robot, planner = Unicycle(Pose2D(50.0, 50.1)), Ours()
    for k in range(60):
        robot = robot.step(
            *planner.command(
                view(robot.pose, Seen(53.5, 50.0, 0.0, 0.0), boxes=[wall], v=robot.v, w=robot.w)
            ),
            0.1,
            SIZE,
        )
        assert not touches(robot.pose, np.empty((0, 2)), np.array([wall])), k


def test_it_goes_where_a_lost_target_should_be() -> None:
    planner, robot = Ours(), Unicycle(Pose2D(50.0, 50.0))
    planner.command(view(robot.pose, Seen(54.8, 50.0, 1.0, 0.0)))
    for k in range(50):
        seen = view(robot.pose, None, v=robot.v, w=robot.w, time_s=0.1 * k)
        robot = robot.step(*planner.command(seen), 0.1, SIZE)
    assert robot.pose.x > 54.0


def test_it_follows_the_trail_of_a_lost_target_round_a_wall() -> None:
    wall = (53.0, 53.0, 0.0, 6.0, 0.4)  # the target goes round its left end, at x = 50
    planner, robot = Ours(), Unicycle(Pose2D(51.5, 51.0))
    way = [(49.0, 51.0 + 0.15 * k) for k in range(20)] + [
        (49.0 + 0.15 * k, 54.0) for k in range(30)
    ]
    for k in range(120):
        place = way[min(k, len(way) - 1)]
        velocity = (0.0, 1.5) if k < 20 else (1.5, 0.0)
        is_hidden = place[1] > 52.0 and robot.pose.y < 52.5
        target = None if is_hidden else Seen(*place, *velocity)
        seen = view(robot.pose, target, boxes=[wall], v=robot.v, w=robot.w)
        robot = robot.step(*planner.command(seen), 0.1, SIZE)
    assert robot.pose.y > 53.5
    assert robot.pose.x > 50.5


def test_a_robot_that_never_saw_the_target_stays() -> None:
    v, w = Ours().command(view(target=None))
    assert (v, w) == (0.0, 0.0)


def test_an_episode_is_the_same_to_the_bit_when_it_is_played_again() -> None:
    episode = generate("Crowd", "left_side", Density(20), 3)
    planner = Ours()
    one, again, other = (
        play(episode, planner, 5),
        play(episode, planner, 5),
        play(episode, Ours(), 5),
    )
    assert np.array_equal(one.robot, again.robot)
    assert np.array_equal(one.robot, other.robot)


def test_it_survives_a_crowd_of_twenty() -> None:
    record = play(generate("Perpendicular", "back", Density(20), 1), Ours(), 1)
    assert not record.collided
    assert record.visible.mean() > 0.8
