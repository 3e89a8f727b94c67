"""Manoeuvres that every engine drives alike, and what is measured on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from mecazen.robot import WHEELS, Robot

from mecazen_bench.energy import Body, Sample

RIM_SPEED = 0.3
"""Speed of the wheels' rims in the manoeuvres [m/s]."""
RAMP_S, SETTLE_S = 0.3, 0.5
"""Time to reach that speed, and to let the transient die away."""
PASSAGES = 16
"""Rollers that pass below each wheel while a manoeuvre is measured."""
TICK_S = 0.01
"""Control period: an engine is asked for its state this often in the timed runs."""
BLOCK_S = 0.25
"""Simulated time of one timed block."""
COAST_S = 1.0
"""Time without motors after which the energy is looked at again."""

FORWARD = (1.0, 1.0, 1.0, 1.0)
LATERAL = (-1.0, 1.0, 1.0, -1.0)
YAW = (-1.0, 1.0, -1.0, 1.0)
MIXED = (0.1, 1.0, 0.6, 0.5)
"""Directions of the wheels in the order of `WHEELS`; the last moves along all axes at once."""

Array = npt.NDArray[np.float64]


class Engine(Protocol):
    """A robot on flat ground, at rest at first, in some simulator."""

    name: str
    robot: Robot
    dt_s: float
    spent_s: float
    """Processor time that its steps have taken so far, without the bench round them [s]."""

    def advance(self, speeds: Sequence[float], steps: int) -> Sample:
        """Simulate `steps` steps of `dt_s` towards the wheel speeds [rad/s]."""

    def coast(self, steps: int) -> Sample:
        """Simulate `steps` steps of `dt_s` with motors that have no torque."""


class Accuracy(NamedTuple):
    """How an engine moves the robot.

    A gain is the distance or the angle moved over that of the ideal equations for the
    wheels' measured turning, over whole passages of rollers. `ripple` is the height of
    base_link's origin from its lowest to its highest while driving straight [m]. `energy` is
    the share that the kinetic energy of a robot gains in a second in which it coasts straight
    on, see `Body`: on a smooth round wheel none.
    """

    ripple: float
    forward: float
    lateral: float
    yaw: float
    energy: float


def measure_accuracy(engine: Engine) -> Accuracy:
    """Drive forward and coast, drive sideways and turn on the spot."""
    robot = engine.robot
    moved, heights = _steady(engine, FORWARD)
    energy = _coast(engine)
    forward = _turned(moved, FORWARD) * robot.wheels.radius_m
    forward_gain = math.hypot(*(moved[-1] - moved[0])[:2]) / forward
    moved, _ = _steady(engine, LATERAL)
    lateral = _turned(moved, LATERAL) * robot.wheels.radius_m
    lateral_gain = math.hypot(*(moved[-1] - moved[0])[:2]) / lateral
    moved, _ = _steady(engine, YAW)
    lever = robot.half_wheelbase + robot.half_track
    yaw = _turned(moved, YAW) * robot.wheels.radius_m / lever
    heading = np.unwrap(moved[:, 2])
    return Accuracy(
        ripple=float(np.ptp(heights)),
        forward=forward_gain,
        lateral=lateral_gain,
        yaw=float(heading[-1] - heading[0]) / yaw,
        energy=energy,
    )


def measure_speed(engines: Sequence[Engine], blocks: int) -> list[list[float]]:
    """Return for each engine the processor time of a step [s] in each block.

    The engines take turns, so that what else the machine does meets all alike.
    """
    for engine in engines:
        _reach(engine, MIXED)
    times: list[list[float]] = [[] for _ in engines]
    for _ in range(blocks):
        for engine, seconds in zip(engines, times, strict=True):
            seconds.append(_time_block(engine))
    return times


def _time_block(engine: Engine) -> float:
    ticks, steps = round(BLOCK_S / TICK_S), round(TICK_S / engine.dt_s)
    speeds = _speeds(engine.robot, MIXED)
    before = engine.spent_s
    for _ in range(ticks):
        engine.advance(speeds, steps)
    return (engine.spent_s - before) / (ticks * steps)


def _coast(engine: Engine) -> float:
    """Let a robot roll on; return what share of its energy it gains in a second.

    Speeds are means over the passage of a roller, so that a wheel that is a polygon does not
    seem to gain or lose by the corner that it stands on.
    """
    body = Body.of(engine.robot)
    passage = 2.0 * math.pi / engine.robot.rollers.count
    steps = round(passage * engine.robot.wheels.radius_m / (RIM_SPEED * engine.dt_s))
    rest = round(COAST_S / engine.dt_s) - steps
    samples = [engine.coast(1), engine.coast(steps), engine.coast(rest), engine.coast(steps)]
    duration = steps * engine.dt_s
    before = body.energy(samples[0], samples[1], duration)
    after = body.energy(samples[2], samples[3], duration)
    return (after / before - 1.0) / COAST_S


def _steady(engine: Engine, direction: Sequence[float]) -> tuple[Array, Array]:
    """Return (x, y, yaw, wheels' angles) and the heights at each step of a steady motion."""
    _reach(engine, direction)
    speeds = _speeds(engine.robot, direction)
    passage = 2.0 * math.pi / engine.robot.rollers.count
    steps = round(PASSAGES * passage / (max(map(abs, speeds)) * engine.dt_s))
    samples = [engine.advance(speeds, 1) for _ in range(steps + 1)]
    moved = np.array([(s.x, s.y, s.yaw, *s.wheels) for s in samples])
    return moved, np.array([s.z for s in samples])


def _reach(engine: Engine, direction: Sequence[float]) -> None:
    """Bring the wheels from wherever they are through rest to steady motion."""
    steps = round(TICK_S / engine.dt_s)
    for _ in range(round(SETTLE_S / TICK_S)):
        engine.advance([0.0] * len(WHEELS), steps)
    ramp = RAMP_S / TICK_S
    for tick in range(round((RAMP_S + SETTLE_S) / TICK_S)):
        part = min(1.0, tick / ramp)
        engine.advance([part * speed for speed in _speeds(engine.robot, direction)], steps)


def _speeds(robot: Robot, direction: Sequence[float]) -> list[float]:
    return [part * RIM_SPEED / robot.wheels.radius_m for part in direction]


def _turned(moved: Array, direction: Sequence[float]) -> float:
    """Return the mean angle that the wheels have turned in their directions [rad]."""
    return float(np.mean((moved[-1] - moved[0])[3:] * direction))
