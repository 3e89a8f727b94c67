"""The person's motion: on a path known for all times, or driven by twists; and the gait."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from mecazen.config.people import Gait
from mecazen.geometry import Pose2D, Twist2D


class PersonMotion(NamedTuple):
    """The person's motion at one time."""

    pose: Pose2D
    """Pose in the world; yaw is the heading."""
    twist: Twist2D = Twist2D()
    """Velocity in the person's frame: x forward, y left."""
    distance: float = 0.0
    """Distance travelled since the start [m]."""


class PersonPath(NamedTuple):
    """A motion known for all times."""

    duration: float
    """Time from which on the person stands [s]; inf for an endless path."""
    at: Callable[[float], PersonMotion]
    """Return the motion at any time [s]; at rest before 0 and after the end."""


class DrivenWalk:
    """The person moves with the last commanded twist, from `start` in the world.

    They stop `timeout` [s] after the last command; `tick_s` is the duration of a step.
    """

    def __init__(self, start: Pose2D, timeout: float, tick_s: float) -> None:
        self.motion = PersonMotion(start)
        self._command = Twist2D()
        self._tick_s = tick_s
        self._timeout_ticks = math.ceil(timeout / tick_s - 1e-9)
        self._ticks_left = 0

    def command(self, twist: Twist2D) -> None:
        """Set the twist [m/s, rad/s] in the person's frame for the next steps."""
        self._command = twist
        self._ticks_left = self._timeout_ticks

    def step(self, ticks: int = 1) -> PersonMotion:
        """Advance by `ticks` >= 1 and return the new motion."""
        moving = min(ticks, self._ticks_left)
        self._ticks_left -= moving
        pose, _, distance = self.motion
        twist, duration = self._command, moving * self._tick_s
        walked = math.hypot(twist.x, twist.y) * duration
        pose = pose.integrate(twist, duration)
        self.motion = PersonMotion(pose, twist if moving == ticks else Twist2D(), distance + walked)
        return self.motion


def with_gait(motion: PersonMotion, gait: Gait) -> PersonMotion:
    """Return `motion` with the gait oscillation.

    The displacements are functions of the distance travelled s and the step length L, in the
    person's frame: forward r·L/(2·pi)·sin(2·pi·s/L), which makes the speed v·(1 +
    r·cos(2·pi·s/L)), and to the left A·sin(pi·s/L). So the step frequency is v/L, and a standing
    person does not sway. Heading and distance are those of the path; the twist is the derivative
    of the new pose.

    The centre of mass sways once per stride (two steps), by about 7 cm peak to peak at 0.7 m/s and
    4 cm at 1.6 m/s (M. S. Orendurff et al., The effect of walking speed on center of mass
    displacement, J. Rehabil. Res. Dev. 41, 2004). Its speed oscillates once per step, as the body
    rises over the supporting leg and falls (D. A. Winter,
    Biomechanics and Motor Control of Human Movement; L. Tesio, V. Rota, The motion of body
    center of mass during walking, Front. Neurol. 10:999, 2019).
    """
    pose, twist, s = motion
    phase = math.pi * s / gait.step_length_m
    x = gait.speed_ripple * gait.step_length_m / math.tau * math.sin(2.0 * phase)
    y = gait.sway_m * math.sin(phase)
    speed = math.hypot(twist.x, twist.y)
    dx = gait.speed_ripple * speed * math.cos(2.0 * phase)
    dy = gait.sway_m * math.pi / gait.step_length_m * speed * math.cos(phase)
    return PersonMotion(
        pose.compose(Pose2D(x, y)),
        Twist2D(twist.x + dx - twist.yaw * y, twist.y + dy + twist.yaw * x, twist.yaw),
        s,
    )
