"""Wheels by the published equations, and motion within its limits: axes, twists and arrays."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from harness import load_robot
from hypothesis import example, given
from hypothesis import strategies as st
from mecazen.config import ControllerConfig, PhysicsConfig, Scenario, SensorConfig
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.drive import Drive, LimiterState, Limits, MotionLimits, limit
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.wheels import MecanumKinematics, Watchdog, WheelCommand
from msgspec.structs import replace

ROBOT = MecanumKinematics(wheel_radius=0.05, half_wheelbase=0.15, half_track=0.1)
STILL = (0.0,) * 4
# the wheels of nexus, 0.05 m, move it at 0.5 m/s forward and 0.25 m/s to the left
DIAGONAL = WheelCommand((5.0, 15.0, 15.0, 5.0))

any_speed = st.floats(-100.0, 100.0)
fast_twists = st.builds(Twist2D, any_speed, any_speed, any_speed)


@pytest.mark.parametrize(
    ("cross_gain", "twist", "wheels"),
    [
        (1.0, (0.5, 0.0, 0.0), (10.0, 10.0, 10.0, 10.0)),
        (1.0, (0.0, 0.5, 0.0), (-10.0, 10.0, 10.0, -10.0)),
        # 0.25 m of lever at 2 rad/s is 0.5 m/s
        (1.0, (0.0, 0.0, 2.0), (-10.0, 10.0, -10.0, 10.0)),
        (1.0, (1.0, -0.5, 0.4), (28.0, 12.0, 8.0, 32.0)),
        # cot 30° = 1.7321: slower to the side; a lever of 0.1 + 1.7321·0.15 = 0.3598 m
        (math.sqrt(3.0), (0.0, 0.5, 0.0), (-17.3205, 17.3205, 17.3205, -17.3205)),
        (math.sqrt(3.0), (0.0, 0.0, 2.0), (-14.3923, 14.3923, -14.3923, 14.3923)),
        # an O is an X to the other side; a lever of 0.1 - 0.15 = -0.05 m
        (-1.0, (0.0, 0.5, 0.0), (10.0, -10.0, -10.0, 10.0)),
        (-1.0, (0.0, 0.0, 2.0), (2.0, -2.0, 2.0, -2.0)),
    ],
)
def test_equations_by_hand_both_ways(cross_gain, twist, wheels):
    robot = MecanumKinematics(0.05, 0.15, 0.1, cross_gain)
    assert robot.inverse(Twist2D(*twist)) == pytest.approx(wheels, abs=1e-4)  # as many digits
    assert robot.forward(robot.inverse(Twist2D(*twist))) == pytest.approx(twist, abs=1e-12)


def test_a_twist_is_that_of_base_link():
    # 0.2 m behind the wheels' centre, which moves to the left at 0.2 m/s in a turn of 1 rad/s
    robot = MecanumKinematics(0.05, 0.15, 0.1, centre=(0.2, 0.0))
    assert robot.inverse(Twist2D(0.0, 0.0, 1.0)) == pytest.approx((-9.0, 9.0, -1.0, 1.0))
    twist = Twist2D(1.0, -0.5, 0.4)
    robot = MecanumKinematics(0.05, 0.15, 0.1, -1.7, (0.1, -0.05))
    assert robot.forward(robot.inverse(twist)) == pytest.approx(twist, abs=1e-12)


def test_lengths_with_which_an_o_cannot_turn_are_refused():
    robot = load_robot()
    wide = replace(robot.wheels, track_m=0.5)
    robot = replace(robot, wheels=wide, rollers=replace(robot.rollers, arrangement="O"))
    assert MecanumKinematics.from_robot(robot).lever == pytest.approx(0.25 - 0.15)
    with pytest.raises(ConfigError, match=r"half_track_m = 0\.15, .* lever of 0 m"):
        MecanumKinematics.from_robot(robot, ControllerConfig(half_track_m=0.15))


@given(fast_twists, st.floats(0.1, 50.0))
def test_desaturation_keeps_the_direction_of_motion(twist, max_speed):
    wheels = ROBOT.inverse(twist)
    limited = wheels.desaturate(max_speed)
    fastest = max(map(abs, wheels))
    assert max(map(abs, limited)) <= max_speed
    if fastest <= max_speed:
        assert limited == wheels
    ratio = min(1.0, max_speed / fastest) if fastest else 1.0
    expected = Twist2D(*(ratio * v for v in twist))
    assert ROBOT.forward(limited) == pytest.approx(expected, abs=1e-9)


@given(st.floats(0.2, 5.0), st.floats(0.3, 2.0), st.floats(0.05, 0.5), fast_twists)
def test_a_drive_is_slowed_as_the_controller_slows_wheels(rim_speed, sideways, lever, twist):
    radius, half = 0.05, 0.15
    kinematics = MecanumKinematics(radius, half, lever - half * sideways, sideways)
    driven = kinematics.forward(kinematics.inverse(twist).desaturate(rim_speed / radius))
    # speeds are rounded, and divided by a lever of 0.05 m
    assert Drive(rim_speed, sideways, lever).slowed(twist) == pytest.approx(driven, abs=1e-9)


def watchdog(**changes):
    return Watchdog(Scenario(robot=load_robot(), **changes))


@pytest.mark.parametrize(
    ("changes", "timeout_s"),
    [
        ({"physics": PhysicsConfig(watchdog_s=0.1)}, 0.1),
        # behind a guard, for no longer than the guard counts on
        ({"sensor": SensorConfig(also=("lidar",))}, 0.05),
    ],
)
def test_a_command_is_obeyed_until_it_is_too_old(changes, timeout_s):
    dog = watchdog(**changes)
    assert dog.command(None, math.inf, STILL).values == STILL
    assert dog.command(DIAGONAL, timeout_s, STILL) is DIAGONAL
    assert dog.command(None, timeout_s + 0.01, STILL) != DIAGONAL
    assert dog.command(DIAGONAL, 0.0, STILL) is DIAGONAL  # a new command ends the braking


def test_each_axis_of_the_robot_brakes_as_the_controller_brakes_it():
    limits = AxisLimits(LinearLimits(2.0, 2.5), LinearLimits(2.0, 5.0), AngularLimits())
    dog = watchdog(controller=ControllerConfig(limits=limits))
    dog.command(DIAGONAL, 0.0, STILL)
    for n in range(1, 21):
        command = dog.command(None, 1.0 + 0.01 * n, STILL)
        forward, left = max(0.5 - 0.025 * n, 0.0), max(0.25 - 0.05 * n, 0.0)
        expected = [(forward - left) / 0.05, (forward + left) / 0.05]
        assert command.values[:2] == pytest.approx(expected, abs=1e-9)


def test_after_an_effort_it_brakes_from_the_measured_speeds():
    dog = watchdog()
    dog.command(WheelCommand((0.3,) * 4, is_effort=True), 0.0, STILL)
    braking = dog.command(None, 1.0, (8.0,) * 4)
    # 2.5 m/s² are 0.5 rad/s in a tick
    assert (braking.values, braking.is_effort) == (pytest.approx([7.5] * 4), False)


DT = 0.01
REST = LimiterState()
EXCESS = 1.0 + 1e-6
"""Differences of rounded velocities, divided by dt and dt², carry their rounding with them."""
values = st.floats(0.05, 50.0)
backwards = st.one_of(st.none(), st.floats(-4.0, 0.0))
any_limits = st.builds(
    Limits,
    velocity=st.one_of(st.just(math.inf), st.floats(0.1, 10.0)),
    acceleration=values,
    deceleration=values,
    jerk=st.one_of(st.just(math.inf), st.floats(0.5, 5000.0)),
    min_velocity=backwards,
)
references = st.floats(-5.0, 5.0)
reference_runs = st.lists(st.tuples(references, st.integers(1, 60)), min_size=1, max_size=6)

positive = st.floats(0.1, 10.0)
finite_limits = st.builds(
    Limits,
    velocity=st.floats(0.5, 4.0),
    acceleration=positive,
    deceleration=positive,
    min_velocity=backwards,
)


def drives_with(limits):
    return st.builds(
        Drive,
        rim_speed=st.one_of(st.just(math.inf), st.floats(0.2, 5.0)),
        sideways=st.floats(0.3, 2.0),
        lever=st.floats(0.05, 0.5),
        axes=st.tuples(limits, limits, limits),
    )


drives = drives_with(finite_limits)
speeds = st.floats(-4.0, 4.0)
twists = st.builds(Twist2D, speeds, speeds, speeds)


def run(state, reference, limits, ticks):
    states = [state]
    for _ in range(ticks):
        states.append(limit(states[-1], reference, limits, DT))
    return states


def drive_axis(runs, limits):
    states = [REST]
    for reference, ticks in runs:
        states += run(states[-1], reference, limits, ticks)[1:]
    return states


def settle(state, reference, limits):
    """Run until the reference is held; fail where that takes longer than any plan can."""
    states = [state]
    while states[-1] != (reference, 0.0):
        states.append(limit(states[-1], reference, limits, DT))
        assert len(states) < 60_000
    return states


def clipped(velocity, limits):
    return min(max(velocity, limits.lowest), limits.velocity)


def assert_within(states, limits):
    for before, after in pairwise(states):
        # velocities of 1 m/s that should add up to 0 leave some 1e-17
        assert limits.lowest * EXCESS - 1e-15 <= after.velocity <= limits.velocity * EXCESS
        slope = (after.velocity - before.velocity) / DT
        assert slope == pytest.approx(after.acceleration, rel=1e-6, abs=1e-9)
        # a tick starts and ends on one side of zero, or the limits are the same
        speeding = abs(after.velocity) > abs(before.velocity)
        bound = limits.acceleration if speeding else limits.deceleration
        assert abs(after.acceleration) <= bound * EXCESS
        assert abs(after.acceleration - before.acceleration) <= limits.jerk * DT * EXCESS


@pytest.mark.parametrize(
    ("limits", "start", "reference", "velocities"),
    [
        # 0.025 m/s a tick at 2.5 m/s² and 10 ms, then the exact reference
        (Limits(acceleration=2.5, deceleration=2.5), 0.0, 0.06, [0.025, 0.05, 0.06, 0.06]),
        (Limits(acceleration=1.0, deceleration=4.0), 0.1, 0.0, [0.06, 0.02, 0.0]),
        # backwards at most as fast as the lowest velocity
        (Limits(1.0, 2.5, 2.5, min_velocity=-0.04), 0.0, -0.5, [-0.025, -0.04, -0.04]),
        # a reversal brakes with one limit and speeds up with the other
        (Limits(acceleration=1.0, deceleration=4.0), 0.06, -1.0, [0.02, 0.0, -0.01, -0.02]),
        # steps of 0.1 m/s² a tick: 1, 2, 3, 2, 1 of them add up to 0.009 m/s
        (Limits(jerk=10.0), 0.0, 0.009, [0.001, 0.003, 0.006, 0.008, 0.009]),
    ],
)
def test_an_axis_moves_as_computed_by_hand(limits, start, reference, velocities):
    states = run(LimiterState(start), reference, limits, len(velocities))
    assert [state.velocity for state in states[1:]] == pytest.approx(velocities)


# a reversal from so low a speed that the product of both speeds is 0
@example(Limits(acceleration=1.0, deceleration=2.0), [(-5e-324, 1), (0.5, 1)], 0.0)
# never backwards, to a rounding
@example(Limits(math.inf, 1.0, 1.0, 1.0, 0.0), [(1.0, 5), (0.0, 13), (1.0, 2)], 0.0)
@given(any_limits, reference_runs, references)
def test_every_reference_is_met_exactly_within_the_limits(limits, runs, last):
    # from any state that can be reached; 0.5 m/s³ and 5 m/s need about 10 s
    last = clipped(last, limits)
    driven = drive_axis(runs, limits)
    assert_within(driven, limits)
    states = settle(driven[-1], last, limits)
    assert run(states[-1], last, limits, 5) == [(last, 0.0)] * 6
    assert_within(states, limits)


@given(any_limits, references, references)
def test_from_a_steady_velocity_the_motion_is_monotone(limits, start, reference):
    start, reference = clipped(start, limits), clipped(reference, limits)
    states = settle(LimiterState(start, 0.0), reference, limits)
    progress = [math.copysign(1.0, reference - start) * state.velocity for state in states]
    assert progress == sorted(progress)


@given(any_limits, reference_runs)
def test_a_stop_never_turns_the_motion_around(limits, runs):
    # The velocity may still grow while the acceleration is let off, but never changes sign,
    # unless it did already on its way through zero with the limits that allow it.
    state = drive_axis(runs, limits)[-1]
    states = settle(state, 0.0, limits)
    if state.velocity * state.acceleration >= 0.0:
        assert all(after.velocity * state.velocity >= 0.0 for after in states)


@given(st.floats(0.1, 50.0), st.floats(1.0, 1000.0), st.floats(0.0, 5.0))
def test_jerk_limited_stop_takes_the_time_of_theory(deceleration, jerk, speed):
    limits = Limits(acceleration=deceleration, deceleration=deceleration, jerk=jerk)
    ticks = len(settle(LimiterState(speed, 0.0), 0.0, limits)) - 1
    ramp = deceleration / jerk
    if speed >= deceleration * ramp:
        seconds = speed / deceleration + ramp
    else:
        seconds = 2.0 * math.sqrt(speed / jerk)
    # whole ticks: one each for the beginning of the ramp, its end, and the plateau's ends
    assert abs(ticks * DT - seconds) <= 4 * DT


def limited(state, wanted, ticks):
    """Return the twists of a robot whose axes alone can be as fast as its wheels, by tick."""
    drive, states = Drive(2.0, 1.0, 0.3, (Limits(2.0, 2.5, 2.5),) * 3), []
    for _ in range(ticks):
        state = drive.limited(state, wanted, DT)
        states.append(state)
    return state, [Twist2D(*(axis.velocity for axis in state)) for state in states]


def test_wheels_at_their_limit_keep_the_direction_and_brake_at_once():
    _, reached = limited((REST,) * 3, Twist2D(3.0, -0.5), 100)
    # beyond the limit of the axis counts as 2 m/s; then 2.5 m/s of rim speed become 2
    assert reached[-1] == pytest.approx((1.6, -0.4, 0.0))
    moving, reached = limited((REST,) * 3, Twist2D(2.0, -2.0), 100)
    assert reached[-1] == pytest.approx((1.0, -1.0, 0.0))
    _, reached = limited(moving, Twist2D(), 45)
    assert [twist.x for twist in reached[:3]] == pytest.approx([0.975, 0.95, 0.925])
    assert reached[-1] == Twist2D()


@given(drives, st.lists(st.tuples(twists, twists), min_size=1, max_size=5), positive)
def test_arrays_move_as_single_robots_to_the_bit(drive, pairs, max_speed):
    pairs = [(Twist2D(*map(clipped, start, drive.axes)), wanted) for start, wanted in pairs]
    start, wanted = (np.array(part).T for part in zip(*pairs, strict=True))
    reached = MotionLimits(drive, max_speed, 0.05, len(pairs)).step(start, wanted)
    single = [drive.step(*pair, max_speed, 0.05) for pair in pairs]
    assert reached.T.tolist() == [list(twist) for twist in single]


def symmetric(limits):
    return dataclasses.replace(limits, deceleration=limits.acceleration, jerk=math.inf)


@given(
    drives_with(any_limits),
    st.booleans(),
    st.lists(st.tuples(twists, st.integers(1, 20)), min_size=1, max_size=4),
)
def test_limited_arrays_move_as_single_robots_to_the_bit(drive, is_symmetric, runs):
    if is_symmetric:
        drive = drive._replace(axes=tuple(map(symmetric, drive.axes)))
    limits, state = MotionLimits(drive, math.inf, DT, 2), (REST,) * 3
    twist, acceleration = np.zeros((3, 2)), np.zeros((3, 2))
    for wanted, ticks in runs:
        aim = limits.aim(np.repeat(np.array(wanted)[:, None], 2, axis=1))
        for _ in range(ticks):
            state = drive.limited(state, wanted, DT)
            twist, acceleration = limits.follow(twist, acceleration, aim)
            assert twist.T.tolist() == [[axis.velocity for axis in state]] * 2
