"""Curves by arc length, against circles, the lemniscate and straights by hand."""

import math

import pytest
from mecazen.errors import ConfigError
from mecazen_people.curves import Arcs, Lemniscate, SmoothCurve


def test_arcs_follow_each_other_in_their_tangent():
    arcs = Arcs([(1.0, 0.0), (math.pi, 0.5), (math.inf, 0.0)])  # a quarter of a 2 m circle
    expected = {
        0.5: ((0.5, 0.0, 0.0), 0.0),
        1.0: ((1.0, 0.0, 0.0), 0.5),
        1.0 + math.pi / 2: ((1.0 + math.sqrt(2.0), 2.0 - math.sqrt(2.0), math.pi / 4), 0.5),
        2.0 + math.pi: ((3.0, 3.0, math.pi / 2), 0.0),
    }
    for s, (pose, curvature) in expected.items():
        assert arcs.at(s) == (pytest.approx(pose, abs=1e-12), curvature)
    assert arcs.length == math.inf


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lemniscate_has_its_known_length_width_and_curvature(side):
    curve = Lemniscate(2.0, side)
    half = 2.622057554292119  # the lemniscate constant: half the length at half width 1
    # Simpson's rule with 400 pieces and cubics between: see `Lemniscate`.
    assert curve.at(half)[0] == pytest.approx((0.0, 0.0, -side * math.pi / 2), abs=1e-8)
    assert curve.at(2.0 * half)[0] == pytest.approx((0.0, 0.0, 0.0), abs=1e-8)
    pose, curvature = curve.at(half / 2)  # the far end of the first loop
    end = (math.sqrt(0.5), side * math.sqrt(0.5), side * 0.75 * math.pi)
    assert pose == pytest.approx(end, abs=1e-8)
    assert curvature == pytest.approx(side * 3.0, abs=1e-6)


def test_a_smooth_curve_through_points_on_a_line_is_straight():
    curve = SmoothCurve([(1.0, 1.0), (2.5, 3.0), (4.0, 5.0)])
    assert curve.length == pytest.approx(5.0)
    for s in (0.0, 1.0, 2.5, 5.0):
        pose, curvature = curve.at(s)
        assert pose == pytest.approx((1.0 + 0.6 * s, 1.0 + 0.8 * s, math.atan2(4.0, 3.0)))
        assert curvature == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (((0.0, 0.0), (1.0, 1.0), (1.0, 1.0)), r"points 2 and 3 are the same, \[1.0, 1.0\]"),
        (((0.0, 0.0), (2.0, 0.0), (0.0, 0.0)), "back too sharply at point 2"),
    ],
)
def test_points_that_no_smooth_curve_joins_are_refused(points, message):
    with pytest.raises(ConfigError, match=message):
        SmoothCurve(points)
