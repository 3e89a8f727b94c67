"""A person who stands or walks like a pendulum, for tests that need no recording; and a robot."""

import math

import numpy as np
from harness import load_robot
from mecazen.skeleton import INDEX, JOINTS

NEXUS = load_robot()
HEIGHT = 1.75
SIDES = {"left": 1.0, "right": -1.0}
# Winter's segment lengths (after Drillis & Contini), as shares of the height
THIGH, SHANK, ANKLE, HIP, SHOULDER = 0.245, 0.246, 0.039, 0.0955, 0.1295


def body(hips=(0.0, 0.0), knees=(0.0, 0.0), arms=(0.0, 0.0), pose=(0.0, 0.0, 0.0), height=HEIGHT):
    """Joints in the world (20, 3) [m] of an upright person at `pose` (x, y, yaw).

    Flexions of left and right are in [rad], arms are swung forward; the pelvis's height is such
    that the lower foot touches the ground.
    """
    drop = max(
        THIGH * math.cos(hip) + SHANK * math.cos(hip - knee)
        for hip, knee in zip(hips, knees, strict=True)
    )
    pelvis = drop + ANKLE
    joints = np.zeros((len(JOINTS), 3))

    def put(name, x, y, z):
        joints[INDEX[name]] = x, y, z

    put("pelvis", 0, 0, pelvis)
    put("spine", 0, 0, pelvis + 0.15)
    put("neck", 0, 0, pelvis + 0.288)
    put("head", 0.02, 0, pelvis + 0.288 + 0.08)
    for (side, sign), hip, knee, arm in zip(SIDES.items(), hips, knees, arms, strict=True):
        y = sign * HIP
        shank = hip - knee
        knee_x, knee_z = THIGH * math.sin(hip), pelvis - THIGH * math.cos(hip)
        ankle_x, ankle_z = knee_x + SHANK * math.sin(shank), knee_z - SHANK * math.cos(shank)
        put(f"{side}_hip", 0, y, pelvis)
        put(f"{side}_knee", knee_x, y, knee_z)
        put(f"{side}_ankle", ankle_x, y, ankle_z)
        c, s = math.cos(shank), math.sin(shank)
        for name, ahead, up in (("heel", -0.035, -0.021), ("foot", 0.08, -0.021)):
            put(f"{side}_{name}", ankle_x + c * ahead - s * up, y, ankle_z + s * ahead + c * up)
        shoulder, y = pelvis + 0.288 - 0.02, sign * SHOULDER
        put(f"{side}_shoulder", 0, y, shoulder)
        put(f"{side}_elbow", 0.186 * math.sin(arm), y, shoulder - 0.186 * math.cos(arm))
        put(f"{side}_wrist", 0.332 * math.sin(arm), y, shoulder - 0.332 * math.cos(arm))
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    return height * joints @ np.array(((c, -s, 0), (s, c, 0), (0, 0, 1))).T + (x, y, 0.0)


def walking(t, pose=(0.0, 0.0, 0.0), stride=1.1):
    """Joints at the time `t` [s] of a walk on the spot: stance like a pendulum, bent in swing."""
    hips, knees = [], []
    for lead in (0.0, 0.5):
        phase = (t / stride + lead) % 1.0
        hips.append(math.radians(8.0 + 22.0 * math.cos(2 * math.pi * phase)))
        swing = max(0.0, math.sin(math.pi * (phase - 0.45) / 0.5)) if 0.45 < phase < 0.95 else 0.0
        knees.append(math.radians(6.0 + 56.0 * swing**2))
    swung = math.radians(20.0) * math.cos(2 * math.pi * t / stride)
    return body(tuple(hips), tuple(knees), (-swung, swung), pose)
