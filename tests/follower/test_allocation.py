"""What the wheels can do is shared out in order: distance, yaw rate, bearing."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from mecazen.drive import Drive, Limits
from mecazen.geometry import Twist2D, rotate
from mecazen_follower.allocation import Wanted, allocate
from scipy.optimize import linprog

LINEAR, ANGULAR = Limits(2.0, 2.5, 2.5), Limits(3.0, 8.0, 8.0)
NEXUS = Drive(2.0, 1.0, 0.3, (LINEAR, LINEAR, ANGULAR))
AGES = 10.0
"""A step in which every axis reaches all of its velocities [s]."""

speeds, rates = st.floats(-3.0, 3.0), st.floats(-5.0, 5.0)
# between rounding and its own tolerance of 1e-7 the reference solver is not exact
directions = st.floats(-math.pi, math.pi).map(lambda angle: round(angle, 3))
wishes = st.builds(Wanted, speeds, speeds, rates, st.just(False))
drives = st.builds(
    Drive, st.floats(0.5, 3.0), st.floats(0.5, 2.0), st.just(0.3), st.just(NEXUS.axes)
)


def rims(twist, drive):
    return abs(twist.x) + drive.sideways * abs(twist.y) + drive.lever * abs(twist.yaw)


@pytest.mark.parametrize("direction", [0.0, 1e-17, 2e-12, 1e-7, -1e-7])
def test_nothing_goes_aside_at_full_speed_for_a_gain_of_nothing(direction):
    strong = Drive(3.0, 1.0, 0.3, NEXUS.axes)
    twist = allocate(Wanted(3.0, 0.0, 0.0), direction, Twist2D(), strong, math.inf, AGES)
    assert twist == pytest.approx((2.0, 0.0, 0.0), abs=1e-6)


@given(wishes, directions, drives)
def test_each_part_is_the_best_that_those_before_it_leave(wanted, direction, drive):
    twist = allocate(wanted, direction, Twist2D(), drive, math.inf, AGES)
    away, around = rotate(twist.x, twist.y, -direction)
    c, s = math.cos(direction), math.sin(direction)
    wheels = [
        (front, drive.sideways * side, drive.lever * turn)
        for front in (1, -1)
        for side in (1, -1)
        for turn in (1, -1)
    ]
    box = [(-axis.velocity, axis.velocity) for axis in drive.axes]
    kept, values = [], []
    for part, wish, got in (
        ((c, s, 0.0), wanted.away, away),
        ((0.0, 0.0, 1.0), wanted.yaw, twist.yaw),
        ((-s, c, 0.0), wanted.around, around),
    ):
        least, most = (
            linprog(
                np.multiply(part, sign), wheels, [drive.rim_speed] * 8, kept or None,
                values or None, bounds=box,
            )
            for sign in (1, -1)
        )  # fmt: skip
        if least.success and most.success:  # else rounding left no twist with the parts before
            # the solver's own tolerance is 1e-7
            assert got == pytest.approx(min(max(wish, least.fun), -most.fun), abs=1e-6)
        kept.append(part)
        values.append(got)


@given(wishes, directions, drives, st.tuples(speeds, speeds, rates), st.floats(0.001, 0.5))
def test_a_step_stays_within_the_limits(wanted, direction, drive, last, dt):
    last = Twist2D(*last)
    near = [axis.reach(now, dt) for axis, now in zip(drive.axes, last, strict=True)]
    assume(rims(last, drive) <= drive.rim_speed)
    assume(all(abs(v) <= axis.velocity for v, axis in zip(last, drive.axes, strict=True)))
    twist = allocate(wanted, direction, last, drive, math.inf, dt)
    assert rims(twist, drive) <= drive.rim_speed + 1e-9  # rounding
    for value, (low, high) in zip(twist, near, strict=True):
        assert low - 1e-9 <= value <= high + 1e-9


def test_the_distance_has_all_it_needs_and_a_turn_only_what_is_left():
    twist = allocate(Wanted(1.5, 2.0, 3.0), math.pi, Twist2D(), NEXUS, math.inf, AGES)
    assert twist == pytest.approx((-1.5, 0.0, 0.5 / 0.3))


def test_a_turn_that_goes_first_has_half_of_the_rims():
    wanted = Wanted(2.0, 0.0, 5.0, turn_first=True)
    twist = allocate(wanted, 0.0, Twist2D(), NEXUS, math.inf, AGES)
    # 3 rad/s, the limit of the axis, are 0.9 m/s of the rims
    assert twist == pytest.approx((1.1, 0.0, 3.0))


def test_a_drive_without_limits_does_all_that_is_wanted():
    twist = allocate(Wanted(3.0, 4.0, 5.0), math.pi / 2, Twist2D(), Drive(), math.inf, 0.01)
    assert twist == pytest.approx((-4.0, 3.0, 5.0))
