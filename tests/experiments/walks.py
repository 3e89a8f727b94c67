"""Walks of the simulated person, as a body tracker might report them."""

import numpy as np
from mecazen.config.people import Body
from mecazen.geometry import Pose2D, Twist2D
from mecazen_experiments.gait.motion import Motion
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.motion import PersonMotion

RATE_HZ = 25.0


def person(speed=1.2, duration_s=12.0, rate_hz=RATE_HZ, body=None):
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
    return Motion(t, joints, np.full(shape, std), np.full(shape, 2))
