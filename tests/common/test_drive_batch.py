"""The motion of many robots is that of one, and that of the controller."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.drive import Drive, LimiterState, Limits, limit_twist
from mecazen.drive_batch import UNLIMITED, MotionLimits, bounds, slow_down
from mecazen.geometry import Twist2D

DT = 0.01
ROUNDING = 1e-9
"""Tolerance for velocities below 4 m/s, summed over 40 ticks."""

positive = st.floats(0.1, 10.0)
limits = st.builds(
    Limits, velocity=st.floats(0.5, 4.0), acceleration=positive, deceleration=positive
)
drives = st.builds(
    Drive,
    rim_speed=st.one_of(st.just(math.inf), st.floats(0.2, 5.0)),
    sideways=st.floats(0.3, 2.0),
    lever=st.floats(0.05, 0.5),
    axes=st.tuples(limits, limits, limits),
)
speeds = st.floats(-4.0, 4.0)
twists = st.builds(Twist2D, speeds, speeds, speeds)


def within(axes, twist):
    """Return a twist that the axes may have."""
    return Twist2D(
        *(min(max(v, -a.velocity), a.velocity) for v, a in zip(twist, axes, strict=True))
    )


@given(drives, st.lists(st.tuples(twists, twists), min_size=1, max_size=5), positive)
def test_many_robots_move_as_one_to_the_bit(drive, pairs, max_speed):
    pairs = [(within(drive.axes, now), wanted) for now, wanted in pairs]
    now, wanted = (np.array(part).T for part in zip(*pairs, strict=True))
    reached = MotionLimits(drive, max_speed, 0.05, len(pairs)).step(now, wanted)
    alone = [drive.step(*pair, max_speed, 0.05) for pair in pairs]
    assert reached.T.tolist() == [list(twist) for twist in alone]


@given(limits, speeds, speeds, st.integers(1, 40))
def test_the_guards_prediction_of_an_axis_is_what_the_controllers_limiter_does(
    one, start, wanted, ticks
):
    start = min(max(start, -one.velocity), one.velocity)
    state = (LimiterState(start), LimiterState(), LimiterState())
    for _ in range(ticks):
        state = limit_twist(state, Twist2D(wanted), (one, one, one), DT)
    velocity = state[0].velocity
    up, down = (np.array([[of * ticks * DT]]) for of in (one.acceleration, one.deceleration))
    (((low,),), ((high,),)) = bounds(np.array([[start]]), up, down)
    assert low - ROUNDING <= velocity <= high + ROUNDING
    aim = min(max(wanted, -one.velocity), one.velocity)
    # a limiter that turns around may begin the tick after it has come to rest
    late = one.acceleration * DT if start * wanted < 0.0 else 0.0
    assert min(max(aim, low), high) == pytest.approx(velocity, abs=late + ROUNDING)


@given(drives, twists)
def test_wheels_that_turn_too_fast_slow_many_robots_as_one(drive, twist):
    predicted, gains = np.array(twist)[:, None], np.array((1.0, drive.sideways, drive.lever))
    slow_down(predicted, gains[:, None], min(drive.rim_speed, UNLIMITED))
    assert predicted[:, 0] == pytest.approx(tuple(drive.slowed(twist)), abs=ROUNDING)
