"""The polar law over several goals at a time: what MPPI samples about."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mecazen_follower.planner.rollout import Array, Command

Floats = npt.NDArray[np.float64]


class PolarGains(NamedTuple):
    """PolarGains [1/s] and decelerations [m/s², rad/s²] of `PolarControl`, and its fastest turn."""

    linear: float
    braking: float
    heading: float
    heading_braking: float
    max_yaw_rate: float


class Goals(NamedTuple):
    """Goal poses (steps, 3, modes), and their velocities along odom's axes (steps, 3, modes).

    `turn` (modes) is the yaw rate with which a goal turns about the person.
    """

    poses: Floats
    velocities: Floats
    turn: Floats


def towards(person: Floats, goals: Goals, gains: PolarGains) -> Command:
    """Return the law of polar.py without its care for the wheels: `Able` sees to these.

    `person` (steps, 3) is where the person will be.
    """

    def command(k: int, x: Array, y: Array, yaw: Array) -> Array:
        px, py = person[k, 0], person[k, 1]
        (gx, gy, heading), (vx, vy, turning) = goals.poses[k], goals.velocities[k]
        offset_x, offset_y = x - px, y - py
        distance = np.maximum(np.hypot(offset_x, offset_y), 1e-6)
        ux, uy = offset_x / distance, offset_y / distance
        reach_x, reach_y = gx - px, gy - py
        wanted = np.hypot(reach_x, reach_y)
        off = np.arctan2(ux * reach_y - uy * reach_x, ux * reach_x + uy * reach_y)
        # with the person, without the goal's turn about them: that is for the robot's distance
        with_x, with_y = vx + goals.turn * reach_y, vy - goals.turn * reach_x
        away = ux * with_x + uy * with_y
        away += _rate(wanted - distance, gains.linear, gains.braking)
        around = ux * with_y - uy * with_x + goals.turn * distance
        around += _rate(distance * off, gains.linear, gains.braking)
        turn = turning + _rate(_wrapped(heading - yaw), gains.heading, gains.heading_braking)
        turn = np.clip(turn, -gains.max_yaw_rate, gains.max_yaw_rate)
        return np.array((ux * away - uy * around, uy * away + ux * around, turn))

    return command


def _rate(error: Array, gain: float, deceleration: float) -> Any:
    size = np.abs(error)
    return np.copysign(np.minimum(gain * size, np.sqrt(2.0 * deceleration * size)), error)


def _wrapped(angle: Array) -> Any:
    return angle - math.tau * np.round(angle / math.tau)
