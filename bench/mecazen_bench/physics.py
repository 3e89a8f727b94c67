"""Our physics: its cost per step, its smoothness, its gains; and the same of other engines."""

from __future__ import annotations

import importlib.util
import math
import statistics
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Any

from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.motors import WheelCommand
from mecazen_physics.rollers import lateral_gain, yaw_gain
from mecazen_physics.world import World

from mecazen_bench import gazebo_peer
from mecazen_bench.energy import Sample
from mecazen_bench.engine import Accuracy, Engine, measure_accuracy, measure_speed
from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.scenarios import robot

ROBOTS = ("nexus", "artbul")
STEPS_S = (0.001, 0.002)
PEERS_STEP_S = 0.001
"""Gazebo's own, unless a world asks for another."""
BLOCKS = 5
OURS: dict[str, dict[str, Any]] = {
    "near rollers": {"rollers": "near"},
    "all rollers": {"rollers": "all"},
}
"""Settings of physics that are measured beside each other, by name."""

HELD = ("nexus", "mecazen, near rollers")
"""Robot and engine whose speed at 1 ms has a target."""
RTF = Target.at_least(40.0)
RIPPLE_PERCENT = Target.below(0.1)
"""At 1 ms."""
GAIN = Target.around(1.0, 0.01)
LATERAL = Target.around(1.0, 0.035)


class DartEngine:
    """The world of our physics service."""

    def __init__(self, robot: Robot, dt_s: float, rollers: str) -> None:
        self.name = f"mecazen, {rollers}"
        self.robot = robot
        self.dt_s = dt_s
        self.spent_s = 0.0
        self._world = World([(robot, Pose2D())], PhysicsConfig(dt_s=dt_s, **OURS[rollers]))

    def advance(self, speeds: Sequence[float], steps: int) -> Sample:
        """Simulate some steps; see `Engine`."""
        begin = time.thread_time()
        self._world.advance([WheelCommand(speeds)], steps)
        self.spent_s += time.thread_time() - begin
        return self._sample()

    def coast(self, steps: int) -> Sample:
        """Simulate some steps without torque; see `Engine`."""
        begin = time.thread_time()
        self._world.advance([WheelCommand([0.0] * len(WHEELS), is_effort=True)], steps)
        self.spent_s += time.thread_time() - begin
        return self._sample()

    def _sample(self) -> Sample:
        state = self._world.robots[0].state()
        x, y, z, w = state.orientation
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return Sample(*state.position, yaw, state.joint_position[: len(WHEELS)])


def run() -> list[Group]:
    """Measure ours: each robot at each step."""
    engines = [
        DartEngine(robot(name), dt_s, rollers)
        for name in ROBOTS
        for dt_s in STEPS_S
        for rollers in OURS
    ]
    return [measure("Physics", engines)]


def run_peers() -> list[Group]:
    """Measure ours beside all other engines that are here."""
    with peers() as (engines, missing):
        group = measure("Physics: ours and others", engines)
    how = "; ".join([group.how, *missing])
    return [Group(group.title, how, group.rows)]


@contextmanager
def peers() -> Iterator[tuple[list[Engine], list[str]]]:
    """Yield every engine with every robot, and a line on each engine that is not here."""
    missing = []
    if not (mujoco := importlib.util.find_spec("mujoco") is not None):
        missing.append("without MuJoCo, which is not installed")
    if not (gazebo := gazebo_peer.PROGRAM.exists()):
        missing.append("without Gazebo's physics, whose program `make bench-peers` builds")
    engines: list[Engine] = []
    with ExitStack() as stack:
        for name in ROBOTS:
            mecanum = robot(name)
            engines += [DartEngine(mecanum, PEERS_STEP_S, rollers) for rollers in OURS]
            if mujoco:
                from mecazen_bench import mujoco_peer  # noqa: PLC0415

                engines += [
                    mujoco_peer.MujocoEngine(mecanum, PEERS_STEP_S, shape)
                    for shape in mujoco_peer.SHAPES
                ]
            if gazebo:
                engines += [
                    stack.enter_context(
                        closing(gazebo_peer.GazeboEngine(mecanum, PEERS_STEP_S, shape))
                    )
                    for shape in gazebo_peer.SHAPES
                ]
        yield engines, missing


def measure(title: str, engines: Sequence[Engine], blocks: int = BLOCKS) -> Group:
    """Measure engines in turns."""
    accuracy = [measure_accuracy(engine) for engine in engines]
    times = measure_speed(engines, blocks)
    how = (
        "processor time of a step on one core, driving along all axes, engines in turns, median "
        f"of {blocks} blocks; ripple: peak to peak of the base's height, driving straight; gains: "
        "motion over that of the ideal equations, and over what the geometry of the rollers "
        "predicts; energy: what the kinetic energy gains in a second of coasting straight on"
    )
    rows = (
        Row(_subject(engine), _figures(engine, statistics.median(seconds), found))
        for engine, seconds, found in zip(engines, times, accuracy, strict=True)
    )
    return Group(title, how, tuple(rows))


def _subject(engine: Engine) -> str:
    return f"{engine.robot.name} {engine.dt_s * 1e3:g} ms {engine.name}"


def _figures(engine: Engine, seconds: float, found: Accuracy) -> dict[str, Figure]:
    """Return the figures of an engine; all are held against the same targets but in speed."""
    held = (engine.robot.name, engine.name) == HELD
    exact = engine.dt_s == 0.001
    lateral, yaw = lateral_gain(engine.robot), yaw_gain(engine.robot)
    percent = 100.0 * found.ripple / engine.robot.wheels.radius_m
    return {
        "µs/step": Figure.of(seconds * 1e6, "less"),
        "× real time": Figure.of(
            engine.dt_s / seconds,
            RTF if held and exact and engine.name == "mecazen, near rollers" else "more",
        ),
        "ripple % of R": Figure.of(percent, RIPPLE_PERCENT if exact else "less"),
        "forward": Figure.of(found.forward, GAIN),
        "lateral": Figure(found.lateral, lateral, target=LATERAL),
        "lateral / predicted": Figure.of(found.lateral / lateral, GAIN),
        "yaw / predicted": Figure.of(found.yaw / yaw, GAIN),
        "energy %/s": Figure.of(100.0 * found.energy, 0.0),
    }
