"""Manoeuvres that all engines drive in the same way, and their measurements."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from mecazen.geometry import Twist2D
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import lateral_gain, yaw_gain
from mecazen.wheels import MecanumKinematics, WheelSpeeds

RIM_SPEED = 0.3
"""Speed of the wheels' rims in the manoeuvres [m/s]."""
RAMP_S, SETTLE_S = 0.3, 0.5
"""Time to reach `RIM_SPEED`, and for the transient to decay."""
PASSAGES = 16
"""Number of rollers that pass below each wheel while a manoeuvre is measured."""
TICK_S = 0.01
"""Control period: in the timed runs an engine reports its state this often."""
BLOCK_S = 0.25
"""Simulated time of one timed block."""
COAST_S = 1.0
"""Time without motor torque between two measurements of the energy."""

FORWARD = (1.0, 1.0, 1.0, 1.0)
LATERAL = (-1.0, 1.0, 1.0, -1.0)
YAW = (-1.0, 1.0, -1.0, 1.0)
MIXED = (0.1, 1.0, 0.6, 0.5)
"""Directions of the wheels in the order of `WHEELS`; the last moves along all axes at once."""


class RobotPose(NamedTuple):
    """Pose of the robot: base_link's origin in world [m], its yaw, and the wheels' angles [rad]."""

    x: float
    y: float
    yaw: float
    wheels: Sequence[float]

    @classmethod
    def from_pose(
        cls, position: Sequence[float], quaternion: Sequence[float], wheels: Sequence[float]
    ) -> RobotPose:
        """Return the sample of a position (x, y, z) and an orientation (x, y, z, w)."""
        qx, qy, qz, qw = quaternion
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        return cls(position[0], position[1], yaw, wheels)


class Engine(ABC):
    """A robot on flat ground, initially at rest, in some simulator."""

    def __init__(self, name: str, robot: Robot, dt_s: float) -> None:
        self.name = name
        self.robot = robot
        self.dt_s = dt_s
        self.spent_s = 0.0
        """Processor time of the engine's steps so far, without the benchmark code [s]."""

    @abstractmethod
    def advance(self, speeds: Sequence[float] | None, steps: int) -> RobotPose:
        """Simulate steps of `dt_s` at wheel speeds [rad/s]; None for motors without torque."""


class Accuracy(NamedTuple):
    """The accuracy with which an engine moves the robot.

    A gain is the measured motion divided by the motion of the ideal equations for the wheels'
    measured rotation, over whole passages of rollers; lateral and yaw gain are divided by those
    that the geometry of the rollers predicts.
    """

    forward: float
    lateral: float
    yaw: float
    energy: float
    """Relative gain of kinetic energy in a second of coasting; 0 on a smooth round wheel."""


def measure_accuracy(engine: Engine) -> Accuracy:
    """Drive forward and coast, drive sideways and turn on the spot."""
    # first, while the rollers of all wheels are in the same phase, as `yaw_gain` assumes
    yaw, ideal_yaw = _steady(engine, YAW)
    forward, ideal_forward = _steady(engine, FORWARD)
    energy = _coast(engine)
    lateral, ideal_lateral = _steady(engine, LATERAL)
    gain = lateral_gain(engine.robot.rollers.count)
    return Accuracy(
        forward=math.hypot(*forward[:2]) / ideal_forward.x,
        lateral=math.hypot(*lateral[:2]) / ideal_lateral.y / gain,
        yaw=yaw[2] / ideal_yaw.yaw / yaw_gain(engine.robot),
        energy=energy,
    )


def measure_speed(engines: Sequence[Engine], blocks: int) -> list[list[float]]:
    """Return the processor time of a step [s], by engine and block.

    Blocks of all engines are interleaved, so that the load of other processes affects all equally.
    """
    for engine in engines:
        _reach(engine, MIXED)
    times: list[list[float]] = [[] for _ in engines]
    ticks = round(BLOCK_S / TICK_S)
    for _ in range(blocks):
        for engine, seconds in zip(engines, times, strict=True):
            steps, speeds = round(TICK_S / engine.dt_s), _speeds(engine.robot, MIXED)
            before = engine.spent_s
            for _ in range(ticks):
                engine.advance(speeds, steps)
            seconds.append((engine.spent_s - before) / (ticks * steps))
    return times


def _coast(engine: Engine) -> float:
    """Return the relative gain of energy of a robot that coasts straight on for a second.

    Wheels that roll turn with the robot's speed, so its kinetic energy is proportional to the
    square. Speeds are means over the passage of a roller: otherwise the energy of a polygonal wheel
    would seem to change with the corner on the ground.
    """
    passage = 2.0 * math.pi / engine.robot.rollers.count
    steps = round(passage * engine.robot.wheels.radius_m / (RIM_SPEED * engine.dt_s))
    between = round(COAST_S / engine.dt_s) - steps
    samples = [engine.advance(None, count) for count in (1, steps, between, steps)]
    before, _, after = (math.dist(a[:2], b[:2]) for a, b in pairwise(samples))
    return ((after / before) ** 2 - 1.0) / COAST_S


def _steady(engine: Engine, direction: Sequence[float]) -> tuple[list[float], Twist2D]:
    """Drive steadily in a direction; return the displacement, and the ideal one.

    The displacement is in x, y [m] and yaw [rad]. The ideal displacement follows from the ideal
    equations, in the robot's axes.
    """
    _reach(engine, direction)
    robot = engine.robot
    speeds = _speeds(robot, direction)
    passage = 2.0 * math.pi / robot.rollers.count
    steps = round(PASSAGES * passage / (max(map(abs, speeds)) * engine.dt_s))
    samples = [engine.advance(speeds, 1) for _ in range(steps + 1)]
    poses = np.array([(s.x, s.y, s.yaw, *s.wheels) for s in samples])
    poses[:, 2] = np.unwrap(poses[:, 2])
    moved: list[float] = (poses[-1] - poses[0]).tolist()
    return moved[:3], MecanumKinematics.from_robot(robot).forward(WheelSpeeds(*moved[3:]))


def _reach(engine: Engine, direction: Sequence[float]) -> None:
    """Bring the wheels through rest to a steady motion."""
    steps = round(TICK_S / engine.dt_s)
    for _ in range(round(SETTLE_S / TICK_S)):
        engine.advance([0.0] * len(WHEELS), steps)
    ramp = RAMP_S / TICK_S
    for tick in range(round((RAMP_S + SETTLE_S) / TICK_S)):
        part = min(1.0, tick / ramp)
        engine.advance([part * speed for speed in _speeds(engine.robot, direction)], steps)


def _speeds(robot: Robot, direction: Sequence[float]) -> list[float]:
    return [part * RIM_SPEED / robot.wheels.radius_m for part in direction]
