"""Walks of known angles and events, as a body tracker might report them."""

import numpy as np
from mecazen.config.people import Body
from mecazen.geometry import Pose2D, Twist2D
from mecazen.skeleton import INDEX, JOINTS
from mecazen_experiments.gait.motion import Motion
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.motion import PersonMotion

RATE_HZ = 25.0
STRIDE_S = 1.1
SPEED_M_S = 1.2
THIGH_M, SHANK_M, HIP_M = 0.43, 0.42, 0.95
"""Lengths, and the height of the hips."""


def pendulum(duration_s=10.0, yaw=0.3, late=0.5, rate_hz=RATE_HZ):
    """Times (n,) and joints (n, 20, 3) of straight legs that swing as cosines.

    The left leg is farthest ahead at the phase 0, the right one `late` strides later.
    """
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    joints = np.zeros((len(t), len(JOINTS), 3))

    def put(name, forward, left, up):
        place = np.broadcast_arrays(SPEED_M_S * t + forward, left, up)
        joints[:, INDEX[name]] = np.stack(place, axis=-1)

    for name, height in (("pelvis", 0.0), ("spine", 0.25), ("neck", 0.5), ("head", 0.7)):
        put(name, 0.0, 0.0, HIP_M + height)
    for side, sign, behind in (("left", 1.0, 0.0), ("right", -1.0, late)):
        thigh = 0.4 * np.cos(2.0 * np.pi * (t / STRIDE_S - behind))
        for name, place in (("shoulder", 0.5), ("elbow", 0.2), ("wrist", 0.0)):
            put(f"{side}_{name}", 0.0, 0.2 * sign, HIP_M + place)
        for name, length, ahead in (
            ("hip", 0.0, 0.0),
            ("knee", THIGH_M, 0.0),
            ("ankle", THIGH_M + SHANK_M, 0.0),
            ("heel", THIGH_M + SHANK_M, -0.06),
            ("foot", THIGH_M + SHANK_M, 0.13),
        ):
            forward = length * np.sin(thigh) + ahead
            put(f"{side}_{name}", forward, 0.08 * sign, HIP_M - length * np.cos(thigh))
    c, s = np.cos(yaw), np.sin(yaw)
    return t, joints @ np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))


def person(speed=SPEED_M_S, duration_s=12.0, rate_hz=RATE_HZ, body=None):
    """Times, joints and phases of the simulated person when the walk is steady."""
    walker, twist, dt = WalkingPerson(body or Body()), Twist2D(x=speed), 1.0 / rate_hz
    walker.reset(PersonMotion(Pose2D()))
    t = np.arange(1, round(duration_s * rate_hz)) * dt
    postures = [walker.step(PersonMotion(Pose2D(x=speed * now), twist), dt) for now in t.tolist()]
    steady = t > 2.5
    joints = np.array([posture.joints for posture in postures])[steady]
    phases = np.array([posture.phases for posture in postures])[steady]
    return t[steady], joints, phases


def reported(t, joints, std=1e-3):
    """Joints as reported with a deviation [m]."""
    shape = joints.shape[:2]
    unknown = np.full((len(t), 2), np.nan)
    return Motion(t, joints, np.full(shape, std), np.full(shape, 2), unknown)
