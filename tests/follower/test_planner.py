"""The planner: the way it takes in a flat world, and what it says of it."""

import math
from collections import deque

import numpy as np
import pytest
from follower.rooms import BODY, DRIVE, TICK, follow, legs, planner_of, scan, standing, wall
from mecazen.config import SensorConfig
from mecazen.config.follower import PidControl
from mecazen.geometry import Pose2D, Standoff, Twist2D, wrap
from mecazen_follower.association import Measurement
from mecazen_follower.following import Following
from mecazen_follower.planner.surroundings import MEMORY_S, LocalMap
from mecazen_follower.tracker import Frame

ORIGIN = Pose2D()
SURE = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-3))


def test_the_map_has_pillars_and_walls_and_no_legs():
    around = LocalMap()
    person = Pose2D(1.5, 0.0)
    around.see(0.0, scan(ORIGIN, [*legs(1.5, 0.0), (1.0, 1.5, 0.15)]), ORIGIN, person)
    points = around.standing(ORIGIN)
    assert len(points) >= 2
    assert np.hypot(*(points - (1.0, 1.5)).T) == pytest.approx(0.15, abs=1e-3)
    # a wall as near is not taken for a leg
    around.see(0.1, scan(ORIGIN, wall(0.5, 2.5, 0.3)), ORIGIN, person)
    assert len(around.standing(ORIGIN)) > 10  # of 2 m, a point each 10 cm; aslant less


def test_hidden_points_are_remembered_for_a_while():
    pillar, removed, screen = (2.0, 0.0, 0.1), (0.0, 2.0, 0.1), (1.0, 0.0, 0.2)
    away = Pose2D(-5.0, 0.0)
    around = LocalMap()

    def near(place):
        gaps = np.hypot(*(around.standing(ORIGIN) - place[:2]).T)
        return bool((gaps < 0.15).any())

    around.see(0.0, scan(ORIGIN, [pillar, removed]), ORIGIN, away)
    around.see(0.1, scan(ORIGIN, [screen]), ORIGIN, away)
    assert near(pillar)
    assert not near(removed)
    around.see(MEMORY_S + 0.1, scan(ORIGIN, [screen]), ORIGIN, away)
    assert not near(pillar)


@pytest.mark.parametrize("control", [None, PidControl()])
def test_with_nobody_near_but_the_person_the_command_is_the_laws_own(control):
    config, planner = planner_of({"control": control} if control else None)
    person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
    nominal = Twist2D(0.123456789, -0.2, 0.3)
    for tick in range(30):
        now = 0.05 * tick
        if tick % 2 == 0:
            planner.see(now, scan(ORIGIN, [*legs(1.0, 0.0), (0.0, 3.5, 0.1)]), ORIGIN)
        assert planner.command(now, 0.05, person, ORIGIN, nominal) is nominal
    assert planner.plan == ("open", "")
    assert config.planner is not None


def test_the_plan_reports_what_is_in_the_way_and_when():
    def command():
        _, planner = planner_of()
        person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
        planner.command(0.0, 0.05, person, ORIGIN, Twist2D())
        planner.see(0.0, scan(ORIGIN, [(0.4, 0.25, 0.1)]), ORIGIN)
        return planner.command(0.05, 0.05, person, ORIGIN, Twist2D(0.5)), planner

    first, planner = command()
    assert planner.plan.state != "open"
    assert planner.plan.reason.startswith("an obstacle is in the way in ")
    planner.forget()
    assert planner.plan.state == "open"
    assert command()[0] == first  # the same seed


SIDE = {"view": "side_left", "standoff_m": 1.2}
PLACE = Standoff(1.2, math.pi / 2, -math.pi / 2)
NARROWEST = min(BODY.length, BODY.width)
"""From the middle of the robot to its nearest side [m]."""


def bearings(way):
    """Return the robot's bearing less that of its place, at each tick [deg]."""
    return [math.degrees(PLACE.errors(person, robot).bearing) for robot, person, *_ in way]


def test_a_pillar_in_the_way_is_passed_and_the_side_is_regained():
    way = list(follow(10.0, [(3.0, 1.2, 0.15)], **SIDE))
    assert min(gap for *_, gap in way) > NARROWEST + 0.05  # of the 0.12 m: cells of 6 cm
    assert {state for _, _, state, _ in way} >= {"open", "avoiding"}
    assert way[-1][2] == "open"
    assert bearings(way)[-1] == pytest.approx(0.0, abs=2.0)  # the law's own way back
    assert all(abs(robot.distance(person) - 1.2) < 0.3 for robot, person, *_ in way)


def test_where_the_side_is_blocked_it_goes_behind_and_comes_back_by_itself():
    corridor = wall(3.0, 6.0, 0.85) + wall(3.0, 6.0, -0.85)
    way = list(follow(14.0, corridor, **SIDE))
    off = bearings(way)
    within = [off[k] for k, (robot, *_) in enumerate(way) if 3.5 < robot.x < 5.5]
    assert within
    assert min(within) > 45.0  # nearer to behind, 90 degrees away, than to the side
    assert "gave_up_bearing" in {state for _, _, state, _ in way}
    assert way[-1][2] == "open"
    assert off[-1] == pytest.approx(0.0, abs=2.0)
    assert min(gap for *_, gap in way) > NARROWEST + 0.05
    for robot, person, *_ in way:  # in view all the time
        seen = math.atan2(person.y - robot.y, person.x - robot.x)
        assert abs(math.degrees(wrap(seen - robot.yaw))) < 37.5


def test_before_a_gap_that_is_too_narrow_it_waits():
    room = [(3.0, sign * (0.22 + 0.05 * k), 0.03) for k in range(60) for sign in (1, -1)]
    *_, (robot, person, state, _) = way = list(follow(11.0, room, **SIDE))
    assert state == "waiting"
    assert robot.x < 3.0 < person.x
    assert min(gap for *_, gap in way) > NARROWEST


def test_somebody_who_comes_across_is_let_pass():
    # they would meet the robot beside its person at 3 s
    way = list(follow(7.0, [], walkers=[(1.8, 4.2, 0.0, -0.8)], view="back", standoff_m=1.2))
    straight = list(follow(7.0, [], view="back", standoff_m=1.2))
    met = min(math.dist(r[:2], (1.8, 4.2 - 0.8 * 0.05 * k)) for k, (r, *_) in enumerate(straight))
    assert met < 0.5
    assert min(gap for *_, gap in way) > math.hypot(BODY.length, BODY.width)
    assert way[-1][2] == "open"


@pytest.mark.parametrize("beside", [[], [(0.9, 0.5)]], ids=["alone", "with a walker"])
def test_robot_person_and_walkers_are_predicted_over_the_same_dead_time(beside):
    # At 1.3 m/s and 0.5 s all three are 0.65 m farther when the robot responds. Any of them at
    # another time is in the way: the person's legs, or the walker, who keeps 1.03 m away.
    config, planner = planner_of({"response_s": 0.5, "standoff_m": 1.2})
    following = Following(config, SensorConfig(), DRIVE, planner=planner)
    speed, plans = Twist2D(1.3), []
    robot, twist, sent = Pose2D(), speed, deque([speed] * 10)
    for tick in range(60):
        time, x = TICK * tick, 1.3 * TICK * tick
        person = Pose2D(x + 1.2, 0.0)
        planner.see(time, scan(robot, walkers_at(x, [(1.2, 0.0), *beside])), robot)
        frame = Frame(time, (Measurement(person, SURE),))
        step = following.step(time, TICK, robot, frame)
        plans.append(step.plan.state)
        sent.append(step.command)
        twist = DRIVE.step(twist, sent.popleft(), 2.0, TICK)
        robot = robot.integrate(twist, TICK)
    # the estimate has no velocity at first
    assert set(plans[20:]) == {"open"}


def walkers_at(x, places):
    return [leg for ahead, left in places for leg in legs(x + ahead, left)]
