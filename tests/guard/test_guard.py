"""The share of a twist that is let through, against stopping distances by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from mecazen.drive import Drive, LimiterState, Limits
from mecazen.geometry import Pose2D, Twist2D
from mecazen_guard.guard import BRAKING, Guard, Points

HALF = 0.2, 0.17
DT = 0.01
REACTION_S = 0.06
MARGIN_M = 0.05
DECELERATION = 2.5
AXES = Limits(2.0, DECELERATION, DECELERATION), Limits(2.0, 2.5, 2.5), Limits(3.0, 8.0, 8.0)
DRIVE = Drive(rim_speed=5.0, sideways=1.0, lever=0.3, axes=AXES)


def points(*places, velocity=(0.0, 0.0), stops=False, margin=MARGIN_M):
    count = len(places)
    xy = np.array(places, dtype=float)
    moving = np.tile(np.array(velocity, dtype=float), (count, 1))
    return Points(xy, moving, np.full(count, margin), np.full(count, stops))


def guard_at(twist=Twist2D(), drive=DRIVE):  # noqa: B008  # immutable
    guard = Guard(HALF, drive, REACTION_S)
    guard.begin(twist)
    return guard


def drive(wanted, places, start=Twist2D(), seconds=4.0, rim_speed=5.0):  # noqa: B008
    """Return the poses of a robot that is driven as its controller does it, and the verdicts."""
    limits = DRIVE._replace(rim_speed=rim_speed)
    guard, state = guard_at(start, limits), tuple(map(LimiterState, start))
    poses, verdicts, pose = [Pose2D()], [], Pose2D()
    for _ in range(round(seconds / DT)):
        seen = points(*(pose.between(Pose2D(*place))[:2] for place in places))
        verdicts.append(guard.step(wanted, seen, 0.0, DT))
        state = limits.limited(state, verdicts[-1].twist, DT)
        pose = pose.integrate(Twist2D(*(axis.velocity for axis in state)), DT)
        poses.append(pose)
    return poses, verdicts


def gap(pose, place):
    at = pose.between(Pose2D(*place))
    x, y = abs(at.x) - HALF[0], abs(at.y) - HALF[1]
    return math.hypot(max(x, 0.0), max(y, 0.0)) + min(max(x, y), 0.0)


def stopping_m(speed):
    """By hand: a tick and the reaction time at full speed, then v²/2a."""
    return speed * (DT + REACTION_S) + speed**2 / (2.0 * BRAKING * DECELERATION)


@pytest.mark.parametrize("speed", [0.2, 1.0, 2.0])
def test_a_twist_needs_its_stopping_distance(speed):
    twist, room = Twist2D(x=speed), HALF[0] + MARGIN_M + stopping_m(speed)
    # the braking path is summed up in steps of at most 30 mm by the midpoint rule
    for extra, free in ((0.005, True), (-0.005, False)):
        verdict = guard_at(twist).step(twist, points((room + extra, 0.0)), 0.0, DT)
        assert (verdict.factor == 1.0) == free


def test_the_margin_is_kept_at_all_limits():
    place, start = (1.3, -1.3), Twist2D(1.2, -1.7, 0.2)
    poses, _ = drive(Twist2D(2.43, -1.73, 0.21), [place], start, 1.5, rim_speed=2.0)
    # at 1.4 m/s it moves 14 mm in a tick: the braking path is not the same from one to the next
    assert min(gap(pose, place) for pose in poses) >= MARGIN_M - 5e-3


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi])
def test_a_robot_stops_at_the_margin(heading):
    c, s = math.cos(heading), math.sin(heading)
    poses, verdicts = drive(Twist2D(1.0 * c, 1.0 * s), [(1.5 * c, 1.5 * s)])
    least = min(gap(pose, (1.5 * c, 1.5 * s)) for pose in poses)
    # the last of the approach is as slow as the reaction time allows: 1/64 of the twist is nothing
    assert MARGIN_M - 1e-3 <= least <= MARGIN_M + 0.02
    assert verdicts[0].factor == 1.0
    assert verdicts[-1].factor < 0.02


def test_the_robot_slows_down_steadily():
    _, verdicts = drive(Twist2D(x=1.0), [(1.5, 0.0)])
    factors = np.array([verdict.factor for verdict in verdicts])
    assert np.all(np.diff(factors) <= 1.0 / 64.0 + 1e-9)
    assert np.sum((factors < 1.0) & (factors > 0.1)) > 20


def test_a_corner_does_not_sweep_a_point():
    diagonal = math.hypot(*HALF)
    beside = [(0.0, diagonal - 0.01)]  # within the circle of the corners, outside of the outline
    poses, _ = drive(Twist2D(yaw=2.0), beside, seconds=2.0)
    assert min(gap(pose, beside[0]) for pose in poses) > 0.01
    assert abs(poses[-1].yaw) < math.pi / 2
    free, _ = drive(Twist2D(yaw=2.0), [(0.0, diagonal + MARGIN_M + 0.01)], seconds=2.0)
    assert sum(abs(math.remainder(b.yaw - a.yaw, math.tau)) for a, b in pairwise(free)) > 3.5


def test_motion_along_a_wall_is_let_through():
    wall = [(x / 50.0, HALF[1] + MARGIN_M + 0.02) for x in range(-50, 150)]
    poses, _ = drive(Twist2D(0.5, 0.3), wall, seconds=3.0)
    assert poses[-1].x > 0.8
    assert min(gap(poses[-1], place) for place in wall) >= MARGIN_M - 2e-3


@pytest.mark.parametrize("away", [Twist2D(x=-1.0), Twist2D(x=-0.5, y=0.5)])
def test_motion_away_is_let_through(away):
    verdict = guard_at().step(away, points((HALF[0] + 0.01, 0.0)), 0.0, DT)
    assert (verdict.twist, verdict.factor) == (away, 1.0)


def test_a_robot_can_escape_an_approaching_person():
    person = points((0.6, 0.0), velocity=(-1.0, 0.0), margin=0.3)
    assert guard_at().step(Twist2D(x=-1.0), person, 0.0, DT).factor == 1.0
    assert guard_at().step(Twist2D(x=0.5), person, 0.0, DT).factor == 0.0


def test_a_leaving_person_may_stop_hard():
    speed, stop_s = 1.8, 0.3
    room = HALF[0] + MARGIN_M + stopping_m(speed) - speed * stop_s / 2.0
    for extra, free in ((0.01, True), (-0.01, False)):
        person = points((room + extra, 0.0), velocity=(speed, 0.0), stops=True)
        twist = Twist2D(x=speed)
        assert (guard_at(twist).step(twist, person, 0.0, DT).factor == 1.0) == free


def test_a_jerk_limit_lengthens_the_reaction():
    slow = DRIVE._replace(axes=tuple(Limits(2.0, 2.5, 2.5, jerk=25.0) for _ in range(3)))
    twist, place = Twist2D(x=1.0), points((HALF[0] + MARGIN_M + stopping_m(1.0) + 0.1, 0.0))
    assert guard_at(twist).step(twist, place, 0.0, DT).factor == 1.0
    # (a + d)/j = 0.2 s at 1 m/s are more than the 0.1 m to spare
    assert guard_at(twist, slow).step(twist, place, 0.0, DT).factor < 1.0


def test_a_repeated_tick_counts_once():
    once, twice = guard_at(), guard_at()
    seen = points((1.0, 0.0))
    for _ in range(20):
        once.step(Twist2D(x=2.0), seen, 0.0, DT)
        twice.step(Twist2D(x=-2.0), seen, 0.0, DT)
        twice.step(Twist2D(x=2.0), seen, 0.0, 0.0)
    assert once.step(Twist2D(x=2.0), seen, 0.0, DT) == twice.step(Twist2D(x=2.0), seen, 0.0, DT)
