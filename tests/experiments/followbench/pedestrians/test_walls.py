"""The nearest of many obstacles: distance and way out."""

import math

import pytest
from mecazen.config.world import Box, Cylinder
from mecazen_experiments.followbench.pedestrians.walls import Walls

BOX = Box(size_m=(2.0, 1.0, 1.0), position_m=(5.0, 0.0), yaw_deg=90.0)
POLE = Cylinder(size_m=(0.5, 1.0), position_m=(-3.0, 0.0))


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((0.0, 0.0), (1.0, 0.0, 2.5)),  # the pole, 3 m away
        ((3.0, 0.0), (-1.0, 0.0, 1.5)),  # the turned box: half its width along x
        ((5.0, 3.0), (0.0, 1.0, 2.0)),  # half its length along y
        ((4.6, 0.0), (-1.0, 0.0, -0.1)),  # inside: out through the nearest face
    ],
)
def test_the_nearest_obstacle_counts(place, expected):
    assert Walls([BOX, POLE]).nearest(*place) == pytest.approx(expected, abs=1e-12)  # rounding


def test_without_obstacles_there_is_none():
    assert Walls([]).nearest(1.0, 2.0) == (0.0, 0.0, math.inf)
