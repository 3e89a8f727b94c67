"""The robot's motion within its limits: one axis, and the wheels of all."""

import math
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mecazen.drive import Drive, LimiterState, Limits, limit
from mecazen.geometry import Twist2D

DT = 0.01
REST = LimiterState()
EXCESS = 1.0 + 1e-6
"""Differences of rounded velocities, divided by dt and dt², carry their rounding with them."""

values = st.floats(0.05, 50.0)
any_limits = st.builds(
    Limits,
    velocity=st.one_of(st.just(math.inf), st.floats(0.1, 10.0)),
    acceleration=values,
    deceleration=values,
    jerk=st.one_of(st.just(math.inf), st.floats(0.5, 5000.0)),
)
equal_limits = st.builds(
    lambda a, j: Limits(acceleration=a, deceleration=a, jerk=j), values, st.floats(0.5, 5000.0)
)
references = st.floats(-5.0, 5.0)
reference_runs = st.lists(st.tuples(references, st.integers(1, 60)), min_size=1, max_size=6)


def run(state, reference, limits, ticks, dt=DT):
    states = [state]
    for _ in range(ticks):
        states.append(limit(states[-1], reference, limits, dt))
    return states


def drive(runs, limits):
    states = [REST]
    for reference, ticks in runs:
        states += run(states[-1], reference, limits, ticks)[1:]
    return states


def settle(state, reference, limits):
    """Run until the reference is held; fail where that takes longer than any plan can."""
    ticks = 0
    states = [state]
    while states[-1] != (reference, 0.0):
        states.append(limit(states[-1], reference, limits, DT))
        ticks += 1
        assert ticks < 60_000
    return states


def assert_within(states, limits):
    for before, after in pairwise(states):
        assert abs(after.velocity) <= limits.velocity * EXCESS
        slope = (after.velocity - before.velocity) / DT
        assert slope == pytest.approx(after.acceleration, rel=1e-6, abs=1e-9)
        # A tick starts and ends on one side of zero, or the limits are the same.
        speeding = abs(after.velocity) > abs(before.velocity)
        bound = limits.acceleration if speeding else limits.deceleration
        assert abs(after.acceleration) <= bound * EXCESS
        assert abs(after.acceleration - before.acceleration) <= limits.jerk * DT * EXCESS


def test_acceleration_limit_gives_a_ramp_and_then_the_exact_reference():
    limits = Limits(acceleration=2.5, deceleration=2.5)
    states = run(REST, 0.06, limits, 4)
    # 0.025 m/s a tick at 2.5 m/s² and 10 ms.
    assert [s.velocity for s in states] == pytest.approx([0.0, 0.025, 0.05, 0.06, 0.06])
    assert states[-1] == (0.06, 0.0)


def test_deceleration_has_its_own_limit():
    limits = Limits(acceleration=1.0, deceleration=4.0)
    states = run(LimiterState(0.1, 0.0), 0.0, limits, 3)
    assert [s.velocity for s in states] == pytest.approx([0.1, 0.06, 0.02, 0.0])
    states = run(REST, 0.015, limits, 2)
    assert [s.velocity for s in states] == pytest.approx([0.0, 0.01, 0.015])


def test_reversal_brakes_with_one_limit_and_speeds_up_with_the_other():
    limits = Limits(acceleration=1.0, deceleration=4.0)
    states = run(LimiterState(0.06, 0.0), -1.0, limits, 4)
    assert [s.velocity for s in states] == pytest.approx([0.06, 0.02, 0.0, -0.01, -0.02])


def test_jerk_limit_gives_the_s_curve_computed_by_hand():
    # Steps of 0.1 m/s² a tick: 1, 2, 3, 2, 1 of them add up to 0.009 m/s.
    limits = Limits(jerk=10.0)
    states = run(REST, 0.009, limits, 6)
    assert [s.acceleration for s in states] == pytest.approx([0, 0.1, 0.2, 0.3, 0.2, 0.1, 0])
    assert states[-1] == (0.009, 0.0)


# a reversal from so low a speed that the product of both speeds is 0
@example(Limits(acceleration=1.0, deceleration=2.0), [(-5e-324, 1), (0.5, 1)])
@given(any_limits, reference_runs)
def test_every_tick_is_within_the_limits(limits, runs):
    assert_within(drive(runs, limits), limits)


@given(any_limits, reference_runs, references)
def test_every_reference_is_met_exactly_and_held(limits, runs, last):
    # From any state that can be reached; 0.5 m/s³ and 5 m/s need about 10 s.
    last = min(max(last, -limits.velocity), limits.velocity)
    states = settle(drive(runs, limits)[-1], last, limits)
    assert run(states[-1], last, limits, 5) == [(last, 0.0)] * 6
    assert_within(states, limits)


@given(any_limits, references, references)
def test_from_a_steady_velocity_the_way_is_monotone(limits, start, reference):
    start = min(max(start, -limits.velocity), limits.velocity)
    reference = min(max(reference, -limits.velocity), limits.velocity)
    states = settle(LimiterState(start, 0.0), reference, limits)
    way = [math.copysign(1.0, reference - start) * s.velocity for s in states]
    assert way == sorted(way)


@given(any_limits, reference_runs)
def test_a_stop_never_turns_the_motion_around(limits, runs):
    # The velocity may still grow while the acceleration is let off, but never changes sign,
    # unless it did already on its way through zero with the limits that allow it.
    state = drive(runs, limits)[-1]
    states = settle(state, 0.0, limits)
    if state.velocity * state.acceleration >= 0.0:
        assert all(s.velocity * state.velocity >= 0.0 for s in states)


@given(equal_limits, reference_runs, references)
def test_a_reference_is_crossed_at_most_once(limits, runs, last):
    states = settle(drive(runs, limits)[-1], last, limits)
    sides = [math.copysign(1.0, s.velocity - last) for s in states if s.velocity != last]
    assert sum(a != b for a, b in pairwise(sides)) <= 1


@given(st.floats(0.1, 50.0), st.floats(1.0, 1000.0), st.floats(0.0, 5.0))
def test_jerk_limited_stop_takes_the_time_that_theory_gives(deceleration, jerk, speed):
    limits = Limits(acceleration=deceleration, deceleration=deceleration, jerk=jerk)
    ticks = len(settle(LimiterState(speed, 0.0), 0.0, limits)) - 1
    ramp = deceleration / jerk
    if speed >= deceleration * ramp:
        seconds = speed / deceleration + ramp
    else:
        seconds = 2.0 * math.sqrt(speed / jerk)
    # Whole ticks: one each for the beginning of the ramp, its end, and the plateau's ends.
    assert abs(ticks * DT - seconds) <= 4 * DT


NO_RIM_FASTER = Drive(rim_speed=2.0, sideways=1.0, lever=0.3)


def test_no_rim_is_faster_than_it_can_be_and_all_axes_are_slowed_down_alike():
    x, y, yaw = NO_RIM_FASTER.step(Twist2D(), Twist2D(2.0, 2.0, 3.0), 5.0, 10.0)
    assert NO_RIM_FASTER.rims(Twist2D(x, y, yaw)) == pytest.approx(2.0)
    assert (x / yaw, y / yaw) == pytest.approx((2.0 / 3.0, 2.0 / 3.0))


def test_without_limits_of_the_wheels_only_the_planar_speed_is_limited():
    x, y, yaw = Drive().step(Twist2D(), Twist2D(1.0, 1.0, 1.0), 1.0, 10.0)
    assert (math.hypot(x, y), yaw) == (pytest.approx(1.0), 1.0)


FAST_AXES = (Limits(2.0, 2.5, 2.5),) * 3
"""Limits of axes, each of which alone can be as fast as the wheels."""


def driven(state, wanted, ticks, rim_speed=2.0):
    """Return the twists of a robot whose wheels keep a limit, tick by tick."""
    drive, twists = Drive(rim_speed, 1.0, 0.3, FAST_AXES), []
    for _ in range(ticks):
        state = drive.limited(state, wanted, 0.01)
        twists.append(Twist2D(*(axis.velocity for axis in state)))
    return state, twists


def test_wheels_at_their_limit_keep_the_direction_of_what_is_wanted():
    at_rest = (LimiterState(),) * 3
    _, twists = driven(at_rest, Twist2D(3.0, -0.5), 100)
    # beyond the limit of the axis counts as 2 m/s; then 2.5 m/s of rim speed become 2
    assert twists[-1] == pytest.approx((1.6, -0.4, 0.0))


def test_a_robot_whose_wheels_are_at_their_limit_brakes_at_once():
    moving, twists = driven((LimiterState(),) * 3, Twist2D(2.0, -2.0), 100)
    assert twists[-1] == pytest.approx((1.0, -1.0, 0.0))
    _, twists = driven(moving, Twist2D(), 45)
    assert [twist.x for twist in twists[:3]] == pytest.approx([0.975, 0.95, 0.925])
    assert twists[-1] == Twist2D()
