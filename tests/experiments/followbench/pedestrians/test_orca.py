"""ORCA against velocities worked out by hand."""

import math

import pytest
from mecazen_experiments.followbench.pedestrians import orca

HERE, EAST = (0.0, 0.0), (1.0, 0.0)


def test_nobody_near_leaves_the_wanted_velocity_as_it_is():
    assert orca.velocity(HERE, EAST, (0.3, 0.4), [], [], 0.9, 1.5) == (0.3, 0.4)


def test_nobody_goes_faster_than_the_maximum():
    assert orca.velocity(HERE, EAST, (3.0, 0.0), [], [], 0.9, 1.5) == (1.5, 0.0)


def test_each_of_two_who_meet_head_on_makes_half_of_the_change():
    # the relative velocity 2 may grow to 3 m - 0.9 m in a second: by 0.1, half of it here
    chosen = orca.velocity(HERE, EAST, (1.5, 0.0), [(3.0, 0.0, -1.0, 0.0)], [], 0.9, 1.5)
    assert chosen == pytest.approx((1.05, 0.0))


def test_a_blocked_cell_ahead_takes_all_of_the_change():
    # 1.5 m ahead: within a second at most 1.5 - 0.9
    chosen = orca.velocity(HERE, EAST, (1.5, 0.0), [], [(1.5, 0.0)], 0.9, 1.5)
    assert chosen[0] == pytest.approx(0.6)


def test_a_blocked_cell_within_the_radius_changes_nothing():
    chosen = orca.velocity(HERE, EAST, (1.5, 0.0), [], [(0.8, 0.0)], 0.9, 1.5)
    assert chosen == (1.5, 0.0)


def test_whoever_is_too_near_is_left_within_a_step():
    # 0.8 m of 0.9: the gap of 0.1 m in 0.1 s, half of it here
    chosen = orca.velocity(HERE, HERE, HERE, [(0.8, 0.0, 0.0, 0.0)], [], 0.9, 1.5)
    assert chosen == pytest.approx((-0.5, 0.0))


def test_lines_that_cannot_all_be_met_are_violated_equally():
    both = [(0.5, 0.0, 0.0, 0.0), (-0.5, 0.0, 0.0, 0.0)]
    x, _ = orca.velocity(HERE, HERE, HERE, both, [], 0.9, 1.5)
    assert x == pytest.approx(0.0, abs=1e-9)  # rounding


def test_the_direction_of_a_line_has_the_length_one():
    dx, dy, _, _ = orca.line((2.0, 1.0, 1.4, 0.9), EAST, 0.9, 0.5)
    assert math.hypot(dx, dy) == pytest.approx(1.0)
