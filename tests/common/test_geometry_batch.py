"""Many points are placed and measured as one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen import geometry, geometry_batch
from mecazen.geometry import Pose2D

coordinate = st.floats(-10.0, 10.0)
points = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=5)
poses = st.builds(Pose2D, coordinate, coordinate, st.floats(-3.0, 3.0))
ROUNDING = 1e-12
"""Of sums of two products of numbers up to 10."""


@given(poses, points)
def test_points_are_placed_in_a_frame_and_back(frame, places):
    xy = np.array(places)
    composed = geometry_batch.compose(frame, xy)
    alone = [frame.compose(Pose2D(*place))[:2] for place in places]
    assert composed == pytest.approx(np.array(alone), abs=ROUNDING)
    assert geometry_batch.between(frame, composed) == pytest.approx(xy, abs=ROUNDING)


@given(points, st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_the_distances_to_a_rectangle_are_those_of_each_point(places, length, width):
    half = length, width
    x, y = np.array(places).T
    alone = [geometry.to_rectangle(*place, half) for place in places]
    assert geometry_batch.to_rectangle(x, y, half) == pytest.approx(alone, abs=ROUNDING)


def test_a_point_inside_is_as_deep_as_its_nearest_side():
    assert geometry.to_rectangle(0.9, 0.0, (1.0, 0.5)) == pytest.approx(-0.1)
    assert geometry.to_rectangle(2.0, -1.5, (1.0, 0.5)) == pytest.approx(2.0**0.5)


def test_vectors_turn_about_the_z_axis():
    quarter = np.pi / 2
    assert geometry_batch.rotate(np.array([[2.0, 1.0]]), quarter)[0] == pytest.approx((-1.0, 2.0))
    assert geometry_batch.rotate(np.array([2.0, 1.0, 3.0]), -quarter) == pytest.approx(
        (1.0, -2.0, 3.0)
    )
