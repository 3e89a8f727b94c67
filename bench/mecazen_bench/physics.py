"""Cost per step and gains of our physics at several steps, beside other engines."""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from itertools import product

from mecazen.config import PhysicsConfig
from mecazen.config.services import MAX_DT_S
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.robot import WHEELS, Robot
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation

from mecazen_bench import gazebo_peer
from mecazen_bench.engine import Engine, Sample, measure_accuracy, measure_speed
from mecazen_bench.harness import Row, Tables
from mecazen_bench.processes import SCENARIOS

ROBOTS = ("nexus", "artbul")
OURS = "mecazen"
STEPS_S = (0.0005, 0.001, 0.0025, MAX_DT_S)
MUJOCO_STEPS_S = (0.001, MAX_DT_S)
GAZEBO_STEP_S = 0.001
BLOCKS = 5

GAINS = ("forward", "lateral / predicted", "yaw / predicted")
EQUAL_STEP, EQUAL_ERROR = "× ours, equal step", "× ours, equal error"


class DartEngine(Engine):
    """Our physics; raises as `Simulation`."""

    def __init__(self, robot: Robot, dt_s: float) -> None:
        super().__init__(OURS, robot, dt_s)
        self._simulation = Simulation([(robot, Pose2D())], PhysicsConfig(dt_s=dt_s))

    def advance(self, speeds: Sequence[float] | None, steps: int) -> Sample:
        begin = time.thread_time()
        command = WheelCommand([0.0] * len(WHEELS), is_effort=True)
        self._simulation.advance([command if speeds is None else WheelCommand(speeds)], steps)
        self.spent_s += time.thread_time() - begin
        state = self._simulation.robots[0].state
        return Sample.from_pose(
            state.position, state.orientation, state.joint_position[: len(WHEELS)]
        )


def run() -> Tables:
    """Measure our physics and all other installed engines."""
    tables = {}
    for name in ROBOTS:
        with engines(robot(name)) as installed:
            tables[f"Physics engines: {name}"] = measure(installed)
    return tables


def robot(name: str) -> Robot:
    """Return the robot of `configs/robots/<name>.toml`."""
    return load_scenario(SCENARIOS / "back.toml", {"robot": name}).robot


@contextmanager
def engines(mecanum: Robot) -> Iterator[list[Engine]]:
    """Yield every installed engine with a robot; `make gazebo` builds that of Gazebo."""
    installed: list[Engine] = [DartEngine(mecanum, dt_s) for dt_s in STEPS_S]
    if importlib.util.find_spec("mujoco") is not None:
        from mecazen_bench.mujoco_peer import OPTIONS, MujocoEngine  # noqa: PLC0415

        choices = product(MUJOCO_STEPS_S, gazebo_peer.SHAPES, OPTIONS)
        installed += [MujocoEngine(mecanum, *choice) for choice in choices]
    with ExitStack() as stack:
        if gazebo_peer.PROGRAM.exists():
            for shape in gazebo_peer.SHAPES:
                engine = gazebo_peer.GazeboEngine(mecanum, GAZEBO_STEP_S, shape)
                installed.append(stack.enter_context(closing(engine)))
        yield installed


def measure(installed: Sequence[Engine], blocks: int = BLOCKS) -> dict[str, Row]:
    """Measure engines of a robot, interleaved; a row is a step and an engine."""
    accuracy = [measure_accuracy(engine) for engine in installed]
    times = measure_speed(installed, blocks)
    rows: dict[tuple[float, str], Row] = {}
    for engine, seconds, (*gains, energy) in zip(installed, times, accuracy, strict=True):
        rows[engine.dt_s, engine.name] = {
            "µs/step": (statistics.median(seconds) * 1e6, "less"),
            "× real time": (engine.dt_s / statistics.median(seconds), "more"),
            **{name: (gain, "1") for name, gain in zip(GAINS, gains, strict=True)},
            "largest error %": (100.0 * max(abs(gain - 1.0) for gain in gains), "less"),
            "energy %/s": (100.0 * energy, "0"),
        }
    return {
        f"{dt_s * 1e3:g} ms {name}": {**row, **_factors(dt_s, name, rows)}
        for (dt_s, name), row in rows.items()
    }


def _factors(dt_s: float, name: str, rows: Mapping[tuple[float, str], Row]) -> Row:
    """Return the speed of an engine over that of ours: at the same step, and at the same error.

    The second is over our fastest step whose largest error of a gain is no larger.
    """
    if name == OURS:
        return {}
    speed, error = (rows[dt_s, name][column][0] for column in ("× real time", "largest error %"))
    ours = {step: row for (step, engine), row in rows.items() if engine == OURS}
    factors = {}
    if dt_s in ours:
        factors[EQUAL_STEP] = (speed / ours[dt_s]["× real time"][0], "less")
    accurate = [
        row["× real time"][0] for row in ours.values() if row["largest error %"][0] <= error
    ]
    if accurate:
        factors[EQUAL_ERROR] = (speed / max(accurate), "less")
    return factors
