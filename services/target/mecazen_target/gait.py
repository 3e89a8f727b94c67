"""Gait oscillation: the pelvis sways laterally, and its forward speed oscillates.

The centre of mass sways once per stride (two steps), by about 7 cm peak to peak at 0.7 m/s and
4 cm at 1.6 m/s (M. S. Orendurff et al., The effect of walking speed on center of mass
displacement, J. Rehabil. Res. Dev. 41, 2004). Its speed oscillates once per step, as the body
rises over the supporting leg and falls (D. A. Winter,
Biomechanics and Motor Control of Human Movement; L. Tesio, V. Rota, The motion of body
center of mass during walking, Front. Neurol. 10:999, 2019).
"""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D, Twist2D

from mecazen_target.config import Gait
from mecazen_target.motion import Motion


def with_gait(motion: Motion, gait: Gait) -> Motion:
    """Return `motion` with the gait oscillation.

    The displacements are functions of the distance travelled s and the step length L, in the
    person's frame: forward r·L/(2·pi)·sin(2·pi·s/L), which makes the speed v·(1 +
    r·cos(2·pi·s/L)), and to the left A·sin(pi·s/L). So the step frequency is v/L, and a standing
    person does not sway. Heading and distance are those of the path; the twist is the derivative
    of the new pose.
    """
    pose, twist, s = motion
    phase = math.pi * s / gait.step_length_m
    x = gait.speed_ripple * gait.step_length_m / math.tau * math.sin(2.0 * phase)
    y = gait.sway_m * math.sin(phase)
    speed = math.hypot(twist.x, twist.y)
    dx = gait.speed_ripple * speed * math.cos(2.0 * phase)
    dy = gait.sway_m * math.pi / gait.step_length_m * speed * math.cos(phase)
    return Motion(
        pose.compose(Pose2D(x, y)),
        Twist2D(twist.x + dx - twist.yaw * y, twist.y + dy + twist.yaw * x, twist.yaw),
        s,
    )
