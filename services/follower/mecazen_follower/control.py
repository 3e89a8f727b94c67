"""Control laws: the polar law around the person, with its allocation of speed, and the PIDs."""

from __future__ import annotations

import math
from itertools import product

from mecazen.config.follower import Gains, PidControl, PolarControl
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Standoff, Twist2D, rotate, wrap

from mecazen_follower.sight import ALL_AROUND, FieldOfView

TURN_SHARE = 0.5
"""Share of the rim speed that a turn to the person gets before the distance."""
SIGNS = tuple(product((1.0, -1.0), repeat=3))
HEADROOM = 0.2
"""Share of the wheel speed to keep in reserve; if following uses it, the robot turns to the
person."""

CATCH_UP_M_S = 0.2
"""Speed at which to close a gap to a person who walks away: with less, the robot is left behind."""

LINEAR_BRAKING_M_S2, HEADING_BRAKING_RAD_S2 = 2.0, 6.0
"""Decelerations that the robot can achieve."""


def approach(error: float, gain: float, deceleration: float) -> float:
    """Return the rate at which to reduce `error`: proportional, with a `gain` [1/s].

    The rate is limited to √(2 a e), the speed from which the deceleration a stops within e.
    """
    size = abs(error)
    return math.copysign(min(gain * size, math.sqrt(2.0 * deceleration * size)), error)


class PolarController:
    """A control law in polar coordinates around the person.

    Feed-forward moves the robot like a body fixed to the person. Feedback corrects the distance
    along the line to the person, the bearing across it, and the heading: docs/following.md.

    The bearing error is an arc length [m]. `drive` contains the limits of the robot, and `view` the
    field of view in which to keep the person.
    """

    def __init__(
        self,
        standoff: Standoff,
        law: PolarControl,
        drive: Drive,
        view: FieldOfView = ALL_AROUND,
    ) -> None:
        self.configure(standoff, law, drive, view)
        self._last = Twist2D()

    def configure(
        self, standoff: Standoff, law: PolarControl, drive: Drive, view: FieldOfView
    ) -> None:
        self._standoff, self._law, self._drive, self._view = standoff, law, drive, view

    def command(self, goal: Pose2D, goal_velocity: Twist2D, robot: Pose2D, dt: float) -> Twist2D:
        """Return the twist in base_link that keeps the robot with the goal.

        `goal`, `goal_velocity` and `robot` are in odom; `dt` [s] is the time since the last call.
        """
        law, person = self._law, self._standoff.person(goal)
        turn = goal_velocity.yaw
        reach = goal.x - person.x, goal.y - person.y
        with_person = goal_velocity.x + turn * reach[1], goal_velocity.y - turn * reach[0]

        offset = robot.x - person.x, robot.y - person.y
        distance = math.hypot(*offset)
        wanted = math.atan2(reach[1], reach[0])
        bearing = math.atan2(offset[1], offset[0]) if distance > 0.0 else wanted
        direction = bearing - robot.yaw  # in base_link

        linear = law.linear_gain_1_s, LINEAR_BRAKING_M_S2
        away, around = rotate(*with_person, -bearing)
        # direction of the person, relative to the goal's heading
        centre = self._view.centre
        off = wrap(bearing + math.pi - goal.yaw - centre) + centre
        facing = self._facing(rotate(*with_person, -goal.yaw), away, off)
        if abs(off - facing - centre) >= self._view.half and distance > 0.0:
            # at the edge of the view, the heading follows the person
            turn_to_person = rotate(self._last.x, self._last.y, -direction)[1] - around
            feed_forward = turn_to_person / distance
        else:
            feed_forward = turn
        error = wrap(goal.yaw + facing - robot.yaw)
        yaw = feed_forward + approach(error, law.heading_gain_1_s, HEADING_BRAKING_RAD_S2)

        away += approach(self._standoff.distance - distance, *linear)
        around += distance * turn + approach(distance * wrap(wanted - bearing), *linear)
        yaw = min(max(yaw, -law.max_yaw_rate_rad_s), law.max_yaw_rate_rad_s)
        self._last = allocate(
            Twist2D(away, around, yaw),
            direction,
            self._last,
            self._drive,
            law.max_speed_m_s,
            dt,
            turns_first=facing != 0.0,
        )
        return self._last

    def _facing(self, velocity: tuple[float, float], away: float, off: float) -> float:
        """Return how far to turn from the heading of the goal towards the person [rad].

        If the robot faces the person, it reaches its full speed along the line to the person, and
        the bearing yields until the robot is fast enough. So the robot turns the more, the nearer
        the person's motion takes the wheels to their limit at the heading of the goal; up to twice
        as far, if its part along the line with `CATCH_UP_M_S` does, since the robot lags askew. It
        also turns until the person is in view.

        Args:
            velocity: The person's velocity along the axes of the goal [m/s].
            away: The part of the velocity along the line, away from the person [m/s].
            off: The person's direction from the heading of the goal [rad].
        """
        catching_up = abs(away) + CATCH_UP_M_S
        by_line = self._share_of_limit(catching_up * math.cos(off), catching_up * math.sin(off))
        by_motion = self._share_of_limit(*velocity)
        # beside a slower person the robot stays on its axis, and does not turn through the skew
        facing = off * max(by_motion, min(by_line, 2.0 * by_motion))
        half, centre, _ = self._view
        return off - min(max(off - facing, centre - half), centre + half)

    def _share_of_limit(self, x: float, y: float) -> float:
        """Return how far a velocity in base_link [m/s] takes the wheels into `HEADROOM`: 0 to 1."""
        used = (abs(x) + self._drive.sideways * abs(y)) / self._drive.rim_speed
        return min(max((used - 1.0) / HEADROOM + 1.0, 0.0), 1.0)

    def resume(self, twist: Twist2D) -> None:
        """Continue from a twist in base_link that was commanded instead of the last output."""
        self._last = twist

    def stop(self) -> Twist2D:
        self._last = Twist2D()
        return self._last


def allocate(
    target: Twist2D,
    direction: float,
    last: Twist2D,
    drive: Drive,
    max_speed: float,
    dt: float,
    *,
    turns_first: bool = False,
) -> Twist2D:
    """Return the twist in base_link that is as near to `target` as the limits allow.

    First from rest within the limits of speed; if the axes cannot reach that twist in `dt`, then
    from the last twist within their reach. Each time the distance comes first, then the yaw rate,
    then the bearing.

    Args:
        target: The requested twist along axes away from the person and around them.
        direction: Direction from the person to the robot, in base_link [rad].
        last: The previous twist, within the limits.
        drive: The limits of wheels and axes.
        max_speed: Limit of the planar speed [m/s].
        dt: Time since `last` [s].
        turns_first: Whether the yaw rate gets `TURN_SHARE` of the rim speed before the distance.
    """
    share = TURN_SHARE * drive.rim_speed / drive.lever if turns_first and drive.lever > 0.0 else 0.0
    twist = Twist2D(*rotate(target.x, target.y, direction), target.yaw)
    fastest = [(axis.lowest, axis.velocity) for axis in drive.axes]
    is_slow = math.hypot(target.x, target.y) <= max_speed
    if not (is_slow and drive.rims(twist) <= drive.rim_speed and _is_within(twist, fastest)):
        twist = _in_order(Twist2D(), target, direction, share, fastest, drive, max_speed)
    reach = [axis.reach(now, dt) for axis, now in zip(drive.axes, last, strict=True)]
    if _is_within(twist, reach):
        return twist
    target = Twist2D(*rotate(twist.x, twist.y, -direction), twist.yaw)
    return _in_order(last, target, direction, share, reach, drive, max_speed)


def _is_within(twist: Twist2D, ranges: list[tuple[float, float]]) -> bool:
    return all(low <= v <= high for v, (low, high) in zip(twist, ranges, strict=True))


def _in_order(
    twist: Twist2D,
    target: Twist2D,
    direction: float,
    first_yaw: float,
    ranges: list[tuple[float, float]],
    drive: Drive,
    max_speed: float,
) -> Twist2D:
    """Return `twist` after the largest possible share of each step to `target`, in order."""
    c, s = math.cos(direction), math.sin(direction)
    away, around = rotate(twist.x, twist.y, -direction)
    away, around = target.x - away, target.y - around
    turn = min(max(target.yaw, -first_yaw), first_yaw) - twist.yaw if first_yaw else 0.0
    steps = [
        Twist2D(0.0, 0.0, turn),
        Twist2D(c * away, s * away, 0.0),
        Twist2D(0.0, 0.0, target.yaw - twist.yaw - turn),
        Twist2D(-s * around, c * around, 0.0),
    ]
    for step in steps:
        share = _largest_share(twist, step, ranges, drive, max_speed)
        twist = Twist2D(
            twist.x + share * step.x, twist.y + share * step.y, twist.yaw + share * step.yaw
        )
    return twist


def _largest_share(
    twist: Twist2D,
    step: Twist2D,
    ranges: list[tuple[float, float]],
    drive: Drive,
    max_speed: float,
) -> float:
    """Return the largest share, up to 1, of `step` that keeps `twist` within the limits."""
    share = 1.0
    for v, change, (low, high) in zip(twist, step, ranges, strict=True):
        if change:
            share = min(share, ((high if change > 0.0 else low) - v) / change)
    # the speed of the fastest rim is the largest of these sums: `Drive.rims`
    for x, left, turn in SIGNS:
        y, yaw = left * drive.sideways, turn * drive.lever
        change = x * step.x + y * step.y + yaw * step.yaw
        if change > 0.0:
            rim = x * twist.x + y * twist.y + yaw * twist.yaw
            share = min(share, (drive.rim_speed - rim) / change)
    # |v + share * step| = max_speed
    square = step.x * step.x + step.y * step.y
    if square > 0.0:
        along = twist.x * step.x + twist.y * step.y
        spare = max_speed * max_speed - twist.x * twist.x - twist.y * twist.y
        root = math.sqrt(max(along * along + square * spare, 0.0))
        share = min(share, (root - along) / square)
    return max(share, 0.0)


def pid(
    gains: Gains, error: float, rate: float, integral: float, dt: float, feed_forward: float = 0.0
) -> tuple[float, float]:
    """Return u = feed-forward + kp e + ki ∫e dt + kd de/dt, limited, and the integral's term.

    Without feed-forward, equation 3 of "A Virtual Mecanum Wheeled Robot ROS Simulator ...", which
    has no limit. Anti-windup by conditional integration: while the output is saturated, an error
    that would push it further is not integrated.

    Args:
        gains: The gains, and the limit of the output.
        error: The error e. Its derivative is an argument, so angles need no unwrapping here.
        rate: de/dt.
        integral: The integral's term so far, ki ∫e dt.
        dt: Time since the last call [s].
        feed_forward: A term with the unit of the output, that counts towards its limit.
    """
    added = integral + gains.ki * error * dt
    output = feed_forward + gains.kp * error + added + gains.kd * rate
    if abs(output) <= gains.limit or output * error < 0.0:
        integral = added
    return min(max(output, -gains.limit), gains.limit), integral


class PoseController:
    """PIDs for linear x, linear y and angular z in base_link, on the error of the goal pose.

    The derivative is the change of this error since the last call. It includes the jump of the goal
    with every observation, and the goal's apparent motion in base_link when the robot turns.

    With feed-forward, the goal's velocity is added to the output.

    Integrals are in base_link, where slip and the lag in a steady turn are constant.
    """

    def __init__(self, law: PidControl) -> None:
        self.configure(law)
        self._integrals = [0.0, 0.0, 0.0]
        self._last: Pose2D | None = None
        """The last error."""

    def configure(self, law: PidControl) -> None:
        self._law = law

    def command(self, goal: Pose2D, goal_velocity: Twist2D, robot: Pose2D, dt: float) -> Twist2D:
        """Return the twist in base_link that drives the robot to the goal.

        `goal`, `goal_velocity` and `robot` are in odom; `dt` [s] is the time since the last
        call.
        """
        law, error = self._law, robot.between(goal)
        expected = Twist2D()
        if law.feed_forward:
            x, y = rotate(goal_velocity.x, goal_velocity.y, -robot.yaw)
            expected = Twist2D(x, y, goal_velocity.yaw)
        # at the first call the derivative is unknown
        last = error if self._last is None else self._last
        self._last = error
        changes = error.x - last.x, error.y - last.y, wrap(error.yaw - last.yaw)
        outputs = []
        for axis, gains in enumerate((law.x, law.y, law.yaw)):
            rate = changes[axis] / dt
            output, self._integrals[axis] = pid(
                gains, error[axis], rate, self._integrals[axis], dt, expected[axis]
            )
            outputs.append(output)
        return Twist2D(*outputs)

    def resume(self, twist: Twist2D) -> None:
        """Reset the controller: its integrals do not match the twist that was commanded instead."""
        del twist
        self.stop()

    def stop(self) -> Twist2D:
        """Reset the controller and return the zero twist."""
        self._integrals = [0.0, 0.0, 0.0]
        self._last = None
        return Twist2D()
