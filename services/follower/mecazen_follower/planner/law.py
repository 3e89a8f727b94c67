"""The polar law for several goals at a time: the nominal commands around which MPPI samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from mecazen.config.follower import PolarControl
from mecazen.drive import Array
from mecazen.portable import Floats, arctan2

from mecazen_follower.planner.rollout import Command
from mecazen_follower.polar import HEADING_BRAKING_RAD_S2, LINEAR_BRAKING_M_S2


class Goals(NamedTuple):
    """Goal poses (steps, 3, modes), and their velocities along odom's axes (steps, 3, modes).

    `turn` (modes) is the yaw rate at which a goal orbits the person.
    """

    poses: Floats
    velocities: Floats
    turn: Floats


def towards(person: Floats, goals: Goals, law: PolarControl) -> Command:
    """Return the law of polar.py without wheel limits, which `MotionLimits` applies.

    `person` (steps, 3) contains the person's predicted poses.
    """
    n = goals.poses.shape[-1]
    gain, twice_braking = (
        np.repeat(np.array(values)[:, None], n, axis=1)
        for values in (
            (law.linear_gain_1_s, law.linear_gain_1_s, law.heading_gain_1_s),
            (2.0 * LINEAR_BRAKING_M_S2, 2.0 * LINEAR_BRAKING_M_S2, 2.0 * HEADING_BRAKING_RAD_S2),
        )
    )
    reaches = goals.poses[:, :2] - person[:, :2, None]
    lengths = np.hypot(reaches[:, 0], reaches[:, 1])
    # velocity of the person only; the turn about the person is added at the robot's distance
    turned = goals.turn * reaches
    along_x, along_y = goals.velocities[:, 0] + turned[:, 1], goals.velocities[:, 1] - turned[:, 0]

    def command(k: int, x: Array, y: Array, yaw: Array) -> Array:
        (reach_x, reach_y), with_x, with_y = reaches[k], along_x[k], along_y[k]
        offset_x, offset_y = x - person[k, 0], y - person[k, 1]
        distance = np.maximum(np.hypot(offset_x, offset_y), 1e-6)
        ux, uy = offset_x / distance, offset_y / distance
        off = arctan2(ux * reach_y - uy * reach_x, ux * reach_x + uy * reach_y)
        turn = goals.poses[k, 2] - yaw
        turn -= math.tau * np.rint(turn / math.tau)
        error = np.array((lengths[k] - distance, distance * off, turn))
        size = np.abs(error)
        rate = np.copysign(np.minimum(gain * size, np.sqrt(twice_braking * size)), error)
        away = ux * with_x + uy * with_y + rate[0]
        around = ux * with_y - uy * with_x + goals.turn * distance + rate[1]
        turn = goals.velocities[k, 2] + rate[2]
        turn = np.minimum(np.maximum(turn, -law.max_yaw_rate_rad_s), law.max_yaw_rate_rad_s)
        return np.array((ux * away - uy * around, uy * away + ux * around, turn))

    return command
