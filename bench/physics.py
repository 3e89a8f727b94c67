"""Our physics: its cost per step, its smoothness and its gains; beside MuJoCo's."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from typing import Literal

from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.rollers import lateral_gain, yaw_gain
from mecazen_physics.world import World

from bench.engine import Accuracy, Engine, Sample, measure_accuracy, measure_speed
from bench.figures import Figure, Group, Row, Target
from bench.scenarios import robot

ROBOTS = ("nexus", "artbul")
STEPS_S = (0.001, 0.002)
REPETITIONS = 15

RTF = Target.at_least(12.0)
"""Of `nexus` at 1 ms."""
RIPPLE_PERCENT = Target.below(0.1)
FORWARD = Target.around(1.0, 0.01)
LATERAL = Target.around(1.0, 0.035)
PREDICTED = Target.around(1.0, 0.01)


class DartEngine:
    """The world of our physics service."""

    def __init__(self, robot: Robot, dt_s: float, rollers: Literal["near", "all"]) -> None:
        self.name = f"mecazen, {rollers}"
        self.robot = robot
        self.rollers = rollers
        self.dt_s = dt_s
        self._world = World(robot, PhysicsConfig(dt_s=dt_s, rollers=rollers), Pose2D())

    def advance(self, speeds: Sequence[float], steps: int) -> Sample:
        """Simulate some steps; see `Engine`."""
        self._world.advance(speeds, steps)
        state = self._world.state()
        x, y, z, w = state.orientation
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return Sample(*state.position, yaw, state.joint_position[: len(WHEELS)])


def engines() -> list[Engine]:
    """Return every engine for every robot and step; MuJoCo's only where it is installed."""
    found: list[Engine] = []
    for name in ROBOTS:
        for dt_s in STEPS_S:
            found.append(DartEngine(robot(name), dt_s, "near"))
            found.append(DartEngine(robot(name), dt_s, "all"))
            if importlib.util.find_spec("mujoco") is not None:
                from bench.mujoco_peer import SHAPES, MujocoEngine  # noqa: PLC0415

                found += [MujocoEngine(robot(name), dt_s, shape) for shape in SHAPES]
    return found


def run(competitors: Sequence[Engine], repetitions: int = REPETITIONS) -> list[Group]:
    """Measure engines in turns."""
    accuracy = [measure_accuracy(engine) for engine in competitors]
    times = measure_speed(competitors, repetitions)
    return [
        Group(
            "Physics: speed and smoothness",
            f"medians (quartiles) of {repetitions} repetitions in turns, on one core, driving "
            "along all axes; ripple: peak to peak of the base's height, driving straight",
            tuple(
                Row(_subject(engine), _speed(engine, seconds, found.ripple))
                for engine, seconds, found in zip(competitors, times, accuracy, strict=True)
            ),
        ),
        Group(
            "Physics: gains",
            "motion over that of the ideal equations; and, as a ratio, over what the geometry "
            "of the rollers predicts",
            tuple(
                Row(_subject(engine), _gains(engine, found))
                for engine, found in zip(competitors, accuracy, strict=True)
            ),
        ),
    ]


def _subject(engine: Engine) -> str:
    return f"{engine.robot.name} {engine.dt_s * 1e3:g} ms {engine.name}"


def _speed(engine: Engine, seconds: Sequence[float], ripple: float) -> dict[str, Figure]:
    ours = isinstance(engine, DartEngine)
    nexus = engine.robot.name == "nexus" and engine.dt_s == 0.001
    held = nexus and isinstance(engine, DartEngine) and engine.rollers == "near"
    percent = 100.0 * ripple / engine.robot.wheels.radius_m
    return {
        "µs/step": Figure.median([value * 1e6 for value in seconds]),
        "× real time": Figure.median(
            [engine.dt_s / value for value in seconds], RTF if held else None
        ),
        "ripple mm": Figure.of(ripple * 1e3),
        "% of R": Figure.of(percent, RIPPLE_PERCENT if ours and engine.dt_s == 0.001 else None),
    }


def _gains(engine: Engine, found: Accuracy) -> dict[str, Figure]:
    ours = isinstance(engine, DartEngine)
    return {
        "forward": Figure.of(found.forward, FORWARD if ours else None),
        "lateral": Figure.of(found.lateral, LATERAL if ours else None),
        "/ predicted": Figure.of(
            found.lateral / lateral_gain(engine.robot), PREDICTED if ours else None
        ),
        "yaw": Figure.of(found.yaw),
        "yaw / predicted": Figure.of(
            found.yaw / yaw_gain(engine.robot), PREDICTED if ours else None
        ),
    }
