"""Points of the scan and their clusters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from experiments.followbench.planners.views import view
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.planners.scan import center, clusters, points


def test_points_lie_on_what_the_beams_meet() -> None:
    wall = (53.0, 50.0, 0.0, 1.0, 8.0)
    found = points(view(Pose2D(50.0, 50.0, 1.0), None, boxes=[wall]))
    assert len(found) > 20
    front = found[np.abs(found[:, 1] - 50.0) < 3.0]
    assert front[:, 0] == pytest.approx(np.full(len(front), 52.5))


def test_an_empty_world_has_no_points() -> None:
    assert points(view(target=None)).shape == (0, 2)
    assert clusters(np.empty((0, 2))) == []


def test_points_within_reach_of_each_other_are_one_cluster() -> None:
    row = np.array([(0.4 * k, 0.0) for k in range(5)])
    far = row + np.array((5.0, 0.0))
    pair = np.array([(2.0, 9.0), (2.1, 9.0)])
    found = clusters(np.concatenate((far, pair, row)))
    assert [group.tolist() for group in found] == [far.tolist(), row.tolist()]


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2, 2.9])
def test_the_center_is_that_of_the_rectangle(yaw: float) -> None:
    c, s = math.cos(yaw), math.sin(yaw)
    sides = [(0.1 * k, 0.0) for k in range(21)] + [(0.0, 0.1 * k) for k in range(6)] + [(2.0, 0.3)]
    turned = np.array([(3.0 + c * x - s * y, 1.0 + s * x + c * y) for x, y in sides])
    assert center(turned) == pytest.approx((3.0 + c - 0.25 * s, 1.0 + s + 0.25 * c))


def test_the_center_of_points_on_a_line_is_their_middle() -> None:
    assert center(np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])) == pytest.approx((1.0, 1.0))
