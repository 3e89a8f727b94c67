"""Obstacles in the way, and the goals that a plan gives up, for standing robots."""

import math

import numpy as np
import pytest
from follower.rooms import BODY, NOTHING, scene, still
from mecazen.config.follower import PRIORITIES
from mecazen.geometry import Standoff
from mecazen_follower.planner.costs import Costs, Sight
from mecazen_follower.planner.modes import Prediction
from mecazen_follower.planner.verdict import free, verdict

BEHIND = Standoff(1.2, math.pi, 0.0)
COSTS = Costs(PRIORITIES, BEHIND.distance, 0.12, BODY, Sight())
NOBODY = np.empty((3, 0, 2))


def in_the_way(points=NOTHING, movers=NOBODY, clearance=0.12):
    """Return what is in the way of a robot at the origin, whose person is 1.2 m ahead."""
    around = scene(points, person=(1.2, 0.0, 0.0))
    person = Prediction(around.person, np.zeros((3, 3)))
    return free(still(0.0, 0.0), points, movers, BODY, person, around.shadows, clearance, 0.25)


def test_a_point_is_in_the_way_that_is_nearer_than_the_clearance_to_the_robots_side():
    beside = np.array([[0.0, -BODY.width - 0.1]])
    assert in_the_way(beside) == "an obstacle is in the way in 0.2 s"  # of 0.25
    assert in_the_way(beside, clearance=0.09) == ""


def test_somebody_is_in_the_way_from_the_step_in_which_they_come_near():
    near = BODY.person + math.hypot(BODY.length, BODY.width) + 0.1
    coming = np.array([[[0.0, 3.0]], [[0.0, near]], [[0.0, near]]])
    assert in_the_way(movers=coming) == "somebody comes across in 0.5 s"
    assert in_the_way(movers=coming[:1].repeat(3, axis=0)) == ""


def test_a_pillar_between_robot_and_person_would_hide_them():
    assert in_the_way(np.array([[0.8, 0.0]])) == "the person would be hidden in 0.2 s"


def judged(person, way=None, last="open", points=NOTHING):
    return verdict(way or still(0.0, 0.0), scene(points, person), COSTS, BEHIND, "a wall", last)


@pytest.mark.parametrize(
    ("plan", "state"),
    [
        (judged((1.2, 0.0, 0.0)), "avoiding"),
        (judged((1.7, 0.0, 0.0)), "waiting"),
        (judged((2.2, 0.0, 0.0), still(0.5, 0.0)), "gave_up_distance"),
        (judged((1.2, 0.0, 0.0), points=np.array([[0.6, 0.0]])), "gave_up_visibility"),
        (judged((1.2, 0.0, 0.6), still(0.0, 0.0, 0.6)), "gave_up_bearing"),
        (judged((1.2, 0.0, 0.0), still(0.0, 0.0, 0.6)), "gave_up_heading"),
    ],
)
def test_a_plan_is_named_by_the_dearest_thing_that_it_gives_up(plan, state):
    assert plan == (state, "a wall")


@pytest.mark.parametrize("last", ["avoiding", "gave_up_bearing"])
def test_what_was_given_up_is_so_until_it_is_regained_by_half(last):
    def aside(degrees):
        angle = math.radians(degrees)
        return judged((1.2 * math.cos(angle), 1.2 * math.sin(angle), 0.0), last=last).state

    assert aside(20.0) == last  # of 30
    assert aside(14.0) == "avoiding"
