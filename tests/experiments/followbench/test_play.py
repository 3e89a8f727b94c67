"""An episode step by step: who moves when, when it ends, and that it repeats to the bit."""

import math

import msgspec
import numpy as np
import pytest
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.episodes import SAMPLE, read
from mecazen_experiments.followbench.play import World, grid_of, play

OPEN = read(next(SAMPLE.rglob("NormalParallelOrcaH5W0_back_2.yaml")))
CORRIDOR = read(next(SAMPLE.rglob("CorridorOrcaH4W5.6_back_1.yaml")))
DOOR = read(next(SAMPLE.rglob("DoorwayOrcaH2W2.8_left_side_1.yaml")))


class Still:
    def reset(self, seed):
        self.views = []

    def command(self, view):
        self.views.append(view)
        return 0.0, 0.0


class Ahead(Still):
    def command(self, view):
        return 2.0, 0.0


def test_a_robot_that_stands_loses_the_target_and_the_episode_lasts_to_its_end():
    alone = msgspec.structs.replace(OPEN, humans=())
    record = play(alone, Still(), 1)
    assert (len(record.robot), record.collided) == (alone.max_steps + 1, False)
    assert record.visible[0]
    assert not record.visible[-1]
    # from x = 8 to 28 at 1.5 m/s, the first steps slower, and 1 m ahead of the end slower again
    assert math.dist(record.target[-1], (28.0, 15.0)) < 0.2


def test_the_episode_ends_with_the_first_contact_even_if_it_is_with_the_target():
    ahead = msgspec.structs.replace(OPEN, humans=(), robot=Pose2D(6.5, 15.0, 0.0))
    record = play(ahead, Ahead(), 1)
    assert record.collided
    gap = record.target[-2] - record.robot[-1, :2]  # people where they were as the robot moved
    assert gap[0] - 0.6 - 0.3 < 0.01


def test_the_planner_sees_what_is_true_after_all_have_moved():
    planner = Still()
    record = play(OPEN, planner, 1)
    view = planner.views[3]
    assert view.time_s == pytest.approx(0.3)
    assert (view.target.x, view.target.y) == tuple(record.target[3])
    assert view.people[0][:2] in {tuple(one) for one in record.humans[3]}
    assert len(view.ranges) == 200


def test_an_episode_repeats_to_the_bit():
    one, other = (play(DOOR, Ahead(), 1) for _ in range(2))
    for a, b in zip(one[:4], other[:4], strict=True):
        assert np.array_equal(a, b)


def test_people_give_way_to_the_robot_and_the_target_does_not():
    world = World(msgspec.structs.replace(OPEN, robot=Pose2D(11.0, 15.0, math.pi)))
    for _ in range(60):
        world.step(0.0, 0.0)
    # the target brakes where it touches, and walks on at a twentieth of its speed
    assert 10.0 < world.target.states[0][0] < 11.0


def test_the_first_scan_is_empty_and_the_next_one_is_not():
    planner = Still()
    play(DOOR, planner, 1)
    assert set(planner.views[0].ranges) == {5.0}
    assert min(planner.views[1].ranges) < 5.0


def test_people_heed_the_blocked_cells_of_a_square_at_the_origin_alone():
    grid = grid_of(CORRIDOR)  # 40 × 10 m, the lower wall up to y = 2.2 m
    assert grid.near(9.0, 2.5)
    assert grid.near(12.0, 2.5) == []
    assert grid.blocked[11].all()


def test_people_avoid_the_middle_of_a_box_as_if_it_were_a_person():
    box = (33.0, 5.1, 0.0, 0.1, 0.1)
    start, goals = Pose2D(30.0, 5.0), ((38.0, 5.0),)
    walk = CORRIDOR.humans[0]._replace(start=start, goals=goals, plans=False)
    world = World(msgspec.structs.replace(CORRIDOR, humans=(walk,), boxes=(box,)))
    places = []
    for _ in range(40):
        world.step(0.0, 0.0)
        places.append(world.humans.states[0][:2])
    assert places[-1][0] > 34.0
    # the distance to a person's middle is 0.9 m, their radius, 0.1 m and 0.5 m, less overshoots
    assert min(math.dist(place, box[:2]) for place in places) > 0.85
