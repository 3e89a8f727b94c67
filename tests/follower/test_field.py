"""The distances from points, and from where these hide the person."""

import math

import numpy as np
import pytest
from follower.rooms import NOTHING
from mecazen_follower.planner.field import CELL_M, Field, Shadows


def test_the_field_has_the_distance_to_the_nearest_point_and_shadows_lie_behind():
    points = np.array([[1.0, 0.5], [-2.0, 1.0]])
    corners = np.full(2, -2.0), np.full(2, 1.0)
    field = Field(points, *corners)
    for x, y in ((0.0, 0.0), (1.0, 0.5), (-1.7, 0.3)):
        exact = min(math.dist((x, y), point) for point in points)
        found = field.distance(np.array([x]), np.array([y]))[0]
        assert found == pytest.approx(exact, abs=CELL_M)
    assert np.isinf(Field(NOTHING, *corners).distance(np.zeros(1), np.zeros(1)))
    shadows = Shadows(np.zeros((1, 2)), points[None], np.full(2, 0.05))
    x, y = np.array([[2.0, 0.8, 2.0, -4.0]]), np.array([[1.0, 0.4, 0.0, 2.0]])
    # beyond the first, before it, beside it, beyond the second
    assert shadows.hide(x, y, np.hypot(x, y)).tolist() == [[True, False, False, True]]
