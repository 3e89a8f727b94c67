"""The robot of Follow-Bench: how it moves, and what it touches."""

import math

import numpy as np
import pytest
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.unicycle import Unicycle, gaps, touches

SIZE = (30.0, 30.0)
NOBODY = np.empty((0, 2))
NO_BOX = np.empty((0, 5))
ORIGIN = Unicycle(Pose2D(10.0, 10.0, 0.0))


def test_a_step_moves_along_the_old_heading():
    after = ORIGIN.step(1.0, 2.0, 0.1, SIZE)

    assert after.pose == Pose2D(10.1, 10.0, 0.2)


@pytest.mark.parametrize(
    ("now", "wanted", "allowed"),
    [
        (0.0, 2.0, 2.0),  # from rest, any speed
        (0.0, -2.0, -2.0),
        (0.0, 9.0, 2.0),  # the maximum
        (1.0, 2.0, 1.2),  # 2 m/s² for 0.1 s
        (-1.0, -2.0, -1.2),
        (2.0, 0.0, 0.0),  # braking is 50 times harder
        (1.0, -1.5, -1.5),  # and continues beyond zero
    ],
)
def test_a_speed_changes_slowly_away_from_zero_only(now, wanted, allowed):
    after = Unicycle(ORIGIN.pose, v=now).step(wanted, 0.0, 0.1, SIZE)

    assert after.v == pytest.approx(allowed, abs=1e-12)  # rounding


def test_the_yaw_rate_has_limits_of_its_own():
    turning = Unicycle(ORIGIN.pose, w=1.0).step(0.0, 9.0, 0.1, SIZE)

    assert turning.w == pytest.approx(1.0 + 0.1 * math.pi, abs=1e-12)  # rounding


def test_a_robot_at_the_edge_of_the_map_stops_and_stays():
    edge = Unicycle(Pose2D(30.1, 15.0, 0.0), v=1.5)

    assert edge.step(1.7, 0.5, 0.1, SIZE) == Unicycle(edge.pose)


@pytest.mark.parametrize(
    ("x", "y", "is_touched"),
    [
        (0.89, 0.0, True),  # outline to 0.60 m ahead, the person's radius is 0.3 m
        (0.91, 0.0, False),
        (-0.39, 0.0, True),  # 0.10 m behind
        (-0.41, 0.0, False),
        (0.3, 0.57, True),  # 0.275 m beside
        (0.3, 0.58, False),
        (0.82, 0.49, False),  # at a corner the disc is round
    ],
)
def test_the_outline_is_longer_ahead_of_the_axle_than_behind(x, y, is_touched):
    quarter = Pose2D(5.0, 5.0, math.pi / 2)
    person = quarter.compose(Pose2D(x, y))

    assert touches(quarter, np.array([[person.x, person.y]]), NO_BOX) == is_touched


def test_a_gap_is_the_free_space_between_outline_and_person():
    assert gaps(Pose2D(), np.array([[1.4, 0.0]])) == pytest.approx([0.5])


@pytest.mark.parametrize(
    ("box", "is_touched"),
    [
        ((1.59, 0.0, 0.0, 2.0, 1.0), True),
        ((1.61, 0.0, 0.0, 2.0, 1.0), False),
        ((0.25, 0.0, 1.0, 0.1, 0.1), True),  # a box within the outline
        ((0.6 + 0.70, 0.0, math.pi / 4, 1.0, 1.0), True),  # a corner points at the front
        ((0.6 + 0.72, 0.0, math.pi / 4, 1.0, 1.0), False),
        ((0.95, 0.625, math.pi / 4, 0.98, 0.98), False),  # edges at 45° pass by the corner
    ],
)
def test_boxes_are_touched_at_their_edges(box, is_touched):
    assert touches(Pose2D(), NOBODY, np.array([box])) == is_touched


def test_an_empty_world_touches_nothing():
    assert not touches(Pose2D(), NOBODY, NO_BOX)
