"""Pedestrians of Follow-Bench: they reach their goals, give way, and brake where they touch."""

import math
from itertools import pairwise

import pytest
from mecazen.config.world import Box
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.pedestrians.grid import Grid
from mecazen_experiments.followbench.pedestrians.walkers import Errand, Other, Outline, Walkers

RADIUS_M = 0.3


def walkers(*ends, manners="orca", obstacles=(), inflation=5, **options):
    errands = [Errand(Pose2D(*start, 0.0), (goal,), **options) for start, goal in ends]
    grid = Grid(obstacles, (0.0, 0.0), (20.0, 20.0), inflation)
    return Walkers(errands, obstacles, RADIUS_M, manners, grid)


def walk(group, seconds, others=(), dt=STEP_S):
    """Return the places of all at each step."""
    places = []
    for k in range(1, round(seconds / dt) + 1):
        group.step(k * dt, dt, others)
        places.append([state[:2] for state in group.states])
    return places


@pytest.mark.parametrize("manners", ["orca", "sfm"])
def test_who_is_alone_walks_to_the_goal(manners):
    group = walkers(((2.0, 2.0), (12.0, 7.0)), manners=manners)
    last = walk(group, 20.0)[-1][0]
    # ORCA's walker stands 0.1 m before it; no force attracts within 0.8 m
    assert math.dist(last, (12.0, 7.0)) < (0.25 if manners == "orca" else 0.95)


def test_a_walker_has_the_speed_of_1_5_metres_a_second_within_half_a_second():
    group = walkers(((2.0, 2.1), (12.0, 2.1)))
    places = walk(group, 0.5)  # the first way-point is the middle of the own cell
    assert math.dist(places[-1][0], places[-2][0]) == pytest.approx(1.5 * STEP_S)


@pytest.mark.parametrize("manners", ["orca", "sfm"])
def test_two_who_meet_pass_each_other_without_contact(manners):
    group = walkers(((2.0, 5.0), (12.0, 5.2)), ((12.0, 5.2), (2.0, 5.0)), manners=manners)
    places = walk(group, 15.0)
    assert min(math.dist(a, b) for a, b in places) > 2 * RADIUS_M
    assert places[-1][0][0] > 10.0
    assert places[-1][1][0] < 4.0


def test_a_walker_goes_round_a_box_and_does_not_touch_it():
    box = Box(size_m=(2.0, 4.0, 1.0), position_m=(7.0, 5.0))
    # as in the clutter: the way alone keeps clear, so its way-points must not be given up too early
    group = walkers(((2.0, 5.0), (12.0, 5.0)), obstacles=[box], inflation=8, within=1.0)
    places = [place for (place,) in walk(group, 25.0)]
    gaps = [
        math.hypot(max(abs(x - 7.0) - 1.0, 0.0), max(abs(y - 5.0) - 2.0, 0.0)) for x, y in places
    ]
    assert min(gaps) > RADIUS_M
    assert math.dist(places[-1], (12.0, 5.0)) < 0.3


def test_who_touches_something_stands_for_a_step_and_then_creeps():
    group = walkers(((5.0, 5.1), (15.0, 5.1)))
    robot = Other(6.4, 5.1, 0.0, 0.0, 0.0, Outline(1.1, 0.1, 0.3, math.pi))  # 0.3 m to its end
    places = walk(group, 3 * STEP_S, [robot])
    assert places[0][0] == (5.0, 5.1)
    moved = [math.dist(a[0], b[0]) for a, b in pairwise(places)]
    assert max(moved) <= 1.5 * STEP_S / 20.0 + 1e-12  # rounding
    assert min(moved) > 0.0


def test_a_walker_starts_after_the_others():
    group = walkers(((2.0, 5.0), (12.0, 5.0)), start_after=1.0)
    places = walk(group, 2.0)
    assert places[8][0] == (2.0, 5.0)
    assert places[-1][0][0] > 3.0


def test_an_endless_errand_returns_to_its_first_goal():
    group = Walkers(
        [Errand(Pose2D(2.0, 5.0, 0.0), ((6.0, 5.0), (2.0, 5.0)), endless=True, within=0.3)],
        [],
        RADIUS_M,
        "orca",
        Grid([], (0.0, 0.0), (20.0, 20.0), 0),
    )
    x = [place[0][0] for place in walk(group, 20.0)]
    assert max(x[:50]) > 5.5
    assert min(x[50:90]) < 2.5
    assert max(x[90:]) > 5.5
