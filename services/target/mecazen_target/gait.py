"""The ripple of a walking person: the pelvis sways and its forward speed pulses.

The centre of mass moves from side to side once a stride (two steps), by about 7 cm from
peak to peak at 0.7 m/s and 4 cm at 1.6 m/s (M. S. Orendurff et al., The effect of walking
speed on center of mass displacement, J. Rehabil. Res. Dev. 41, 2004), and is slowed and
sped up once a step, as it is lifted over the standing leg and falls from it (D. A. Winter,
Biomechanics and Motor Control of Human Movement; L. Tesio, V. Rota, The motion of body
center of mass during walking, Front. Neurol. 10:999, 2019).
"""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D, Twist2D

from mecazen_target.config import Gait
from mecazen_target.motion import Motion


def with_gait(motion: Motion, gait: Gait) -> Motion:
    """Return `motion` with the ripple of a walking person.

    Displacements are functions of the distance walked s, with steps of length L, in the
    person's own frame: forward r·L/(2·pi)·sin(2·pi·s/L), which makes the speed v·(1 +
    r·cos(2·pi·s/L)), and to the left A·sin(pi·s/L). So the step frequency is v/L, and who
    stands does not sway. The heading and the distance remain the path's; the twist is the
    derivative of the new pose.
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
