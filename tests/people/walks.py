"""Walks, footfalls, independent angles and derivatives for the tests of people."""

import math
from itertools import groupby

import numpy as np
from mecazen.geometry import Pose2D, Twist2D
from mecazen.skeleton import INDEX, SIDES
from mecazen_people.motion import DrivenWalk, with_gait
from mecazen_people.paths import make_path

SETTLED_S = 6.0
"""After which a walk that began at once is steady: lags of 0.08 s have died out to rounding."""


def joint(postures, name):
    """Return the places (n, 3) of a joint."""
    return np.array([posture.joints[INDEX[name]] for posture in postures])


def walk(walker, path, duration):
    """Return the postures on a configured path, one each 10 ms."""
    path, dt = make_path(path), 0.01
    steps = range(1, round(duration / dt) + 1)
    return [walker.reset(path.at(0.0)), *(walker.step(path.at(k * dt), dt) for k in steps)]


def drive(walker, *legs, dt=0.01):
    """Return the postures of a person driven by twists, each for some time [s]."""
    person = DrivenWalk(Pose2D(), 1e6, dt)
    postures = [walker.reset(person.motion)]
    for duration, *twist in legs:
        person.command(Twist2D(*twist))
        postures += [walker.step(person.step(), dt) for _ in range(round(duration / dt))]
    return postures


def stances(postures, side):
    """Return the postures of each whole stance of a side (0 left, 1 right)."""
    phases = [(stands, [*part]) for stands, part in groupby(postures, lambda p: p.standing[side])]
    return [part for stands, part in phases[1:-1] if stands]


def slip(postures):
    """Return how far standing feet move [m].

    It is taken at the heel from heel strike until it rises by more than 5 mm, which comes after the
    foot was flat, and at the ball of the foot from when it is down until toe-off.
    """
    most = 0.0
    for side, name in enumerate(SIDES):
        for stance in stances(postures, side):
            heel, ball = joint(stance, f"{name}_heel"), joint(stance, f"{name}_foot")
            flat = int(np.argmax(ball[:, 2] < 0.005))
            risen = np.flatnonzero(heel[flat:, 2] > 0.005)
            rise = flat + int(risen[0]) if len(risen) else len(heel)
            for part in (heel[:rise, :2], ball[flat:, :2]):
                most = max(most, float(np.ptp(part, axis=0).max()))
    return most


def angles(posture):
    """Return the six sagittal angles [rad] by turning the legs into the pelvis's frame."""
    at = {name: posture.joints[i] for name, i in INDEX.items()}
    y = at["left_hip"] - at["right_hip"]
    y /= np.linalg.norm(y)
    z = at["spine"] - at["pelvis"]
    z = z - (z @ y) * y
    z /= np.linalg.norm(z)
    frame = np.array([np.cross(y, z), y, z])
    found = []
    for side in SIDES:
        hip, knee, ankle, heel, foot = (
            frame @ at[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "heel", "foot")
        )
        thigh, shank, sole = knee - hip, ankle - knee, foot - heel
        found += [
            math.atan2(thigh[0], -thigh[2]) + math.radians(10.0),
            math.acos(thigh @ shank / np.linalg.norm(thigh) / np.linalg.norm(shank)),
            math.asin(-(sole @ shank) / np.linalg.norm(sole) / np.linalg.norm(shank)),
        ]
    return np.array(found)


def differences(path, gait, t, dt):
    """Return the motion at a time [s], and its twist and speed by differences over 2 dt [s]."""
    before, now, after = (
        motion if gait is None else with_gait(motion, gait)
        for motion in (path.at(t - dt), path.at(t), path.at(t + dt))
    )
    step = before.pose.between(after.pose)
    x, y = now.pose.between(after.pose)[:2]
    dx, dy = now.pose.between(before.pose)[:2]
    twist = Twist2D((x - dx) / (2 * dt), (y - dy) / (2 * dt), step.yaw / (2 * dt))
    return now, twist, (after.distance - before.distance) / (2 * dt)
