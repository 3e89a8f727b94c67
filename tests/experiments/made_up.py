"""Runs that are made up, and walks of the simulated person as a body tracker reports them."""

import math

import numpy as np
from mecazen.config.people import Body
from mecazen.geometry import Pose2D, Standoff, Twist2D
from mecazen_experiments.gait.motion import Motion
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.motion import PersonMotion
from mecazen_tools.table import Poses, Table
from mecazen_tools.trajectory import COLUMNS, COVARIANCE, POSE, TWIST

BACK = Standoff(1.0, math.pi, 0.0)
TICK_S = 0.01
RATE_HZ = 25.0


def run(ticks, **given):
    """A run with only the columns that are given; `who=(x, y, yaw)` gives a pose."""
    columns = {name: np.full(ticks, np.nan) for name in COLUMNS}
    columns["t_s"] = np.arange(ticks) * TICK_S
    columns["tracking"] = np.full(ticks, "")
    for who in ("robot", "odom", "target", "estimate"):
        for name, column in zip(POSE, given.pop(who, ()), strict=False):
            columns[f"{who}_{name}"] = np.broadcast_to(column, ticks).astype(float)
    for name, column in given.items():
        columns[name] = np.broadcast_to(column, ticks)
    return Table(columns, TICK_S)


def twist(who, vx, vy=0.0, yaw_rate=0.0):
    return {f"{who}_{name}": value for name, value in zip(TWIST, (vx, vy, yaw_rate), strict=True)}


def line(ticks, yaw=0.0):
    """A person who walks straight on from the origin at 0.2 m/s, towards `yaw` [rad]."""
    way = 0.2 * TICK_S * np.arange(ticks)
    return Poses(way * math.cos(yaw), way * math.sin(yaw), np.full(ticks, yaw))


def covariances(matrix):
    """The columns of one 3x3 covariance, or of one for each tick."""
    matrix = np.asarray(matrix)
    triangle = zip(COVARIANCE, *np.triu_indices(3), strict=True)
    return {f"estimate_{name}": matrix[..., i, j] for name, i, j in triangle}


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
