"""Cubic splines against polynomials and the conditions that define them."""

import math
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen_people.spline import Spline, limited_slopes, natural_slopes

KNOTS = [0.0, 0.5, 2.0, 2.25, 4.0]


def test_spline_is_the_cubic_with_its_values_and_slopes():
    spline = Spline([0.0, 2.0], [1.0, 9.0], [0.0, 12.0])  # 1 + x³
    assert spline.at(1.0) == pytest.approx((2.0, 3.0, 6.0))
    assert spline.at(3.0) == pytest.approx((28.0, 27.0, 18.0))  # beyond the end it goes on
    assert spline.integral(2.0) == pytest.approx(6.0)  # x + x⁴/4


def test_integral_adds_up_over_pieces():
    spline = Spline(KNOTS, [2 * t for t in KNOTS], [2.0] * 5)
    for t in (0.0, 0.4, 0.5, 2.1, 4.0, 5.0, -1.0):
        assert spline.integral(t) == pytest.approx(t * t)


def test_natural_slopes_make_the_second_derivative_continuous_and_0_at_the_ends():
    values = [1.0, -2.0, 0.5, 3.0, -1.0]
    spline = Spline(KNOTS, values, natural_slopes(KNOTS, values))
    assert spline.at(KNOTS[0])[2] == pytest.approx(0.0, abs=1e-12)
    assert spline.at(KNOTS[-1])[2] == pytest.approx(0.0, abs=1e-12)
    for knot in KNOTS[1:-1]:
        # The third derivative is below 1000: 1e-9 aside changes the second by less than 1e-6.
        assert spline.at(knot - 1e-9) == pytest.approx(spline.at(knot), abs=2e-6)


def test_natural_slopes_of_a_line_are_its_slope():
    assert natural_slopes(KNOTS, [3 * t for t in KNOTS]) == pytest.approx([3.0] * 5)
    assert natural_slopes([0.0, 2.0], [0.0, 6.0]) == pytest.approx([3.0, 3.0])


def test_limited_slopes_by_hand():
    # Secants 1, 5, 0 over widths 1, 1, 2: their mean 3 is just three times the flatter one;
    # beside the flat piece 0. At the ends the secants.
    (slopes,) = limited_slopes([0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 6.0, 6.0])
    assert slopes == pytest.approx([1.0, 3.0, 0.0, 0.0])
    # Secants 1, 9: the limit is 3. Secants -1, 3: a turn of the curve keeps its slope 1.
    assert limited_slopes([0.0, 1.0, 2.0], [0.0, 1.0, 10.0])[0][1] == 3.0
    assert limited_slopes([0.0, 1.0, 2.0], [0.0, -1.0, 2.0])[0][1] == 1.0


def test_limit_is_the_same_in_every_frame():
    # Secants (3, 0) and (0, 1): the parabola's slope (1.5, 0.5) is shorter than 3, and
    # stays although its x alone is more than three times the flatter one, 0.
    assert [s[1] for s in limited_slopes([0, 1, 2], [0, 3, 3], [0, 0, 1])] == [1.5, 0.5]
    # Secants (8, 0) and (0, 1): (4, 0.5) is shortened to the length 3.
    x, y = (s[1] for s in limited_slopes([0, 1, 2], [0, 8, 8], [0, 0, 1]))
    assert math.hypot(x, y) == pytest.approx(3.0)
    assert x == pytest.approx(8 * y)


def test_limited_slopes_of_a_parabola_are_its_own():
    (slopes,) = limited_slopes(KNOTS, [t * t for t in KNOTS])
    assert slopes[1:-1] == pytest.approx([1.0, 4.0, 4.5])


@given(st.lists(st.floats(0.0, 100.0), min_size=4, max_size=4))
def test_limited_slopes_keep_growing_values_growing(steps):
    values = list(accumulate(steps, initial=-50.0))
    spline = Spline(KNOTS, values, *limited_slopes(KNOTS, values))
    for i in range(4):
        for part in (0.1, 0.3, 0.5, 0.7, 0.9):
            value, _, _ = spline.at(KNOTS[i] + part * (KNOTS[i + 1] - KNOTS[i]))
            assert values[i] - 1e-10 <= value <= values[i + 1] + 1e-10  # rounding of 100s
