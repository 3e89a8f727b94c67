"""Compensates gain and dead band of real motors: the inverse of the robot file's `motors`."""

from __future__ import annotations

import math

from mecazen.robot import RealMotors
from mecazen.wheels import WheelSpeeds

STILL_RAD_S = 0.05
"""Speed below which a wheel is commanded to stand; compensating the dead band would cause
chatter."""


def compensated(speeds: WheelSpeeds, motors: RealMotors | None) -> WheelSpeeds:
    """Return the speeds to command so that the wheels turn at `speeds` [rad/s].

    A motor turns at its gain times the command less the dead band.
    """
    if motors is None:
        return speeds
    pairs = zip(speeds, motors.gains, strict=True)
    return WheelSpeeds(
        *(
            speed / gain + math.copysign(motors.dead_band_rad_s, speed)
            if abs(speed) > STILL_RAD_S
            else 0.0
            for speed, gain in pairs
        )
    )
