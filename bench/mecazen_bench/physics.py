"""Cost per step, smoothness and gains of our physics at several steps and hulls, and of others."""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from itertools import product
from typing import Any

import msgspec
from mecazen.config import PhysicsConfig
from mecazen.config.services import MAX_DT_S
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation

from mecazen_bench import gazebo_peer
from mecazen_bench.engine import (
    SLIDE_FRICTION,
    Accuracy,
    Engine,
    Sample,
    lateral_gain,
    measure_accuracy,
    measure_slide,
    measure_speed,
    slippery,
    yaw_gain,
)
from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.stack import robot

ROBOTS = ("nexus", "artbul")
STEPS_S = (0.001, MAX_DT_S)
PEERS_STEP_S = 0.001
"""Step of other engines: Gazebo's default."""
PEER = "MuJoCo, capsule"
BLOCKS = 5

CONVERGENCE_S = (0.0005, 0.001, 0.002, 0.0025, 0.005)
SPHERES = (11, 21, 41, 81, 101)
"""Number of spheres in the hull of a roller, at steps of 1 ms."""

RIPPLE_PERCENT: Goal = (None, 0.1)
GAIN: Goal = (0.99, 1.01)
LATERAL: Goal = (0.965, 1.035)


class DartEngine(Engine):
    """Our physics, with or without the projection of positions; raises as `Simulation`."""

    def __init__(self, robot: Robot, dt_s: float, *, projects: bool = True) -> None:
        super().__init__("mecazen" if projects else "mecazen, not projected", robot, dt_s)
        self._simulation = Simulation([(robot, Pose2D())], PhysicsConfig(dt_s=dt_s))
        if not projects:
            self._simulation.robots[0].body.stand = lambda: None  # type: ignore[method-assign]
        self._in_dart_ns = self._steps = 0
        world = self._simulation.robots[0].home
        self._step, world.step = world.step, self._timed_step

    @property
    def in_dart_s(self) -> float:
        """Mean time of a step within DART, without any of our code [s]."""
        return self._in_dart_ns / self._steps / 1e9

    def _timed_step(self, *args: Any) -> None:
        begin = time.perf_counter_ns()
        self._step(*args)
        self._in_dart_ns += time.perf_counter_ns() - begin
        self._steps += 1

    def advance(self, speeds: Sequence[float] | None, steps: int) -> Sample:
        begin = time.thread_time()
        command = WheelCommand([0.0] * len(WHEELS), is_effort=True)
        self._simulation.advance([command if speeds is None else WheelCommand(speeds)], steps)
        self.spent_s += time.thread_time() - begin
        state = self._simulation.robots[0].state
        return Sample.of(state.position, state.orientation, state.joint_position[: len(WHEELS)])


def run() -> list[Group]:
    """Measure our physics for each robot at each step."""
    cases = product(map(robot, ROBOTS), STEPS_S)
    return [measure("Physics", [DartEngine(*case) for case in cases])]


def run_peers() -> list[Group]:
    """Measure our physics and all other installed engines."""
    robots = [robot(name) for name in ROBOTS]
    with peers([slippery(mecanum) for mecanum in robots]) as (engines, _):
        slides = [measure_slide(engine) for engine in engines]
    with peers(robots) as (engines, missing):
        group = measure("Physics engines", engines)
    rows = {
        subject: {**row, **{f"slide {a:g}°": Figure(ratio, 1.0) for a, ratio in of.items()}}
        for (subject, row), of in zip(group.rows.items(), slides, strict=True)
    }
    how = (
        f"{group.how}; slide: deceleration with locked wheels and a friction of "
        f"{SLIDE_FRICTION:g} over that of Coulomb's law, at three yaw angles"
    )
    return [Group(group.title, "; ".join([how, *missing]), rows)]


def run_steps() -> list[Group]:
    """Measure nexus at several steps, and with several hulls at 1 ms."""
    nexus = robot("nexus")
    steps = [DartEngine(nexus, dt_s) for dt_s in CONVERGENCE_S]
    hulls = []
    for spheres in SPHERES:
        rollers = msgspec.structs.replace(nexus.rollers, hull_spheres=spheres)
        engine = DartEngine(msgspec.structs.replace(nexus, rollers=rollers), 0.001)
        engine.name = f"{spheres} spheres"
        hulls.append(engine)
    return [
        measure("Convergence of the step", steps),
        measure("Convergence of the hull", hulls),
    ]


@contextmanager
def peers(robots: Sequence[Robot]) -> Iterator[tuple[list[Engine], list[str]]]:
    """Yield every engine with each robot, and a line on each missing engine."""
    missing = []
    if not (mujoco := importlib.util.find_spec("mujoco") is not None):
        missing.append("without MuJoCo, which is not installed")
    if not (gazebo := gazebo_peer.PROGRAM.exists()):
        missing.append("without Gazebo's physics, whose program `make bench-peers` builds")
    engines: list[Engine] = []
    with ExitStack() as stack:
        for mecanum in robots:
            for projects in (True, False):
                engines += [DartEngine(mecanum, dt_s, projects=projects) for dt_s in STEPS_S]
            if mujoco:
                from mecazen_bench.mujoco_peer import OPTIONS, MujocoEngine  # noqa: PLC0415

                choices = product(STEPS_S, gazebo_peer.SHAPES, OPTIONS)
                engines += [MujocoEngine(mecanum, *choice) for choice in choices]
            if gazebo:
                for shape in gazebo_peer.SHAPES:
                    engine = gazebo_peer.GazeboEngine(mecanum, PEERS_STEP_S, shape)
                    engines.append(stack.enter_context(closing(engine)))
        yield engines, missing


def measure(title: str, engines: Sequence[Engine], blocks: int = BLOCKS) -> Group:
    """Measure engines, interleaved."""
    accuracy = [measure_accuracy(engine) for engine in engines]
    times = measure_speed(engines, blocks)
    how = (
        "processor time of a step on one core, driving along all axes, engines interleaved, "
        f"median of {blocks} blocks; ripple: peak to peak height of the base, driving straight; "
        "gains: motion over that of the ideal equations, and over the prediction from the "
        "rollers' geometry; energy: relative gain in a second of coasting straight on; of MuJoCo: "
        "speed over that of its capsules at the same step"
    )
    rtfs = {
        (engine.robot.name, engine.name, engine.dt_s): engine.dt_s / statistics.median(seconds)
        for engine, seconds in zip(engines, times, strict=True)
    }
    rows = {}
    for ((of, name, dt_s), rtf), engine, found in zip(rtfs.items(), engines, accuracy, strict=True):
        figures = _figures(engine, rtf, found)
        if (peer := rtfs.get((of, PEER, dt_s))) is not None:  # a factor compares equal steps
            figures["of MuJoCo"] = Figure(rtf / peer, "more")
        rows[f"{of} {dt_s * 1e3:g} ms {name}"] = figures
    return Group(title, how, rows)


def _figures(engine: Engine, rtf: float, found: Accuracy) -> dict[str, Figure]:
    lateral, yaw = lateral_gain(engine.robot), yaw_gain(engine.robot)
    percent = 100.0 * found.ripple / engine.robot.wheels.radius_m
    in_dart = (
        {"of it in DART": Figure(engine.in_dart_s * 1e6, "less")}
        if isinstance(engine, DartEngine)
        else {}
    )
    return {
        "µs/step": Figure(engine.dt_s / rtf * 1e6, "less"),
        **in_dart,
        "× real time": Figure(rtf, "more"),
        "ripple % of R": Figure(percent, RIPPLE_PERCENT),
        "forward": Figure(found.forward, GAIN),
        "lateral": Figure(found.lateral, LATERAL),
        "lateral / predicted": Figure(found.lateral / lateral, GAIN),
        "yaw / predicted": Figure(found.yaw / yaw, GAIN),
        "energy %/s": Figure(100.0 * found.energy, 0.0),
    }
