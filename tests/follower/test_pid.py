"""The PID by hand, and what its anti-windup is for."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen_follower.pid import PID, Gains

DT = 0.01


def test_terms_add_up_as_computed_by_hand():
    pid = PID(Gains(kp=2.0, ki=0.5, kd=0.1, limit=10.0))
    # 0.3 + 2 * 1 + 0.5 * 1 * 0.2 - 0.1 * 4
    assert pid.update(1.0, 4.0, 0.2, 0.3) == pytest.approx(2.0)
    # the integral alone is left: 0.1
    assert pid.update(0.0, 0.0, 0.2) == pytest.approx(0.1)


def test_integral_does_not_wind_up_at_the_limit():
    pid = PID(Gains(kp=1.0, ki=1.0, limit=0.5))
    for _ in range(1000):
        assert pid.update(2.0, 0.0, DT) == 0.5
    # With 20 s·m of integral it would stay at its limit for long; it turns at once.
    assert pid.update(-0.1, 0.0, DT) == pytest.approx(-0.101)


def test_integral_is_unwound_while_the_output_is_at_its_limit():
    pid = PID(Gains(kp=0.0, ki=1.0, limit=1.0))
    pid.update(0.9, 0.0, 1.0)
    for _ in range(10):
        # The feed-forward alone holds the output at its limit; the error is against it.
        assert pid.update(-0.05, 0.0, 1.0, feed_forward=5.0) == 1.0
    assert pid.update(0.0, 0.0, 1.0) == pytest.approx(0.4)


def test_integral_removes_the_steady_error_of_a_constant_disturbance():
    pid, position = PID(Gains(kp=2.0, ki=1.0, limit=5.0)), 0.0
    for _ in range(3000):
        position += (pid.update(1.0 - position, 0.0, DT) - 0.3) * DT
    # e^-t decides: 30 s leave less than 1e-10.
    assert position == pytest.approx(1.0, abs=1e-6)


finite = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(finite, finite, finite), min_size=1, max_size=30))
def test_output_is_always_finite_and_within_the_limit(inputs):
    pid = PID(Gains(kp=3.0, ki=2.0, kd=0.5, limit=1.5))
    for error, rate, feed_forward in inputs:
        output = pid.update(error, rate, DT, feed_forward)
        assert math.isfinite(output)
        assert abs(output) <= 1.5
