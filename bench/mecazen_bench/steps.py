"""What a physics step, and the spheres of a roller's hull, cost and bring: convergence."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from mecazen.robot import Robot
from mecazen_experiments.config import Case
from mecazen_experiments.jobs import Job, expand
from mecazen_experiments.local import LocalWorkers
from mecazen_experiments.schedule import run_all
from mecazen_experiments.store import Store
from mecazen_physics.rollers import lateral_gain, yaw_gain

from mecazen_bench.engine import measure_accuracy, measure_speed
from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.physics import BLOCKS, DartEngine
from mecazen_bench.stack import SCENARIOS, robot

STEPS_S = 0.0005, 0.001, 0.002, 0.0025, 0.005
SPHERES = 11, 21, 41, 81, 101
DURATION_S = 40.0

GAIN = Target(0.995, 1.005)
RIPPLE_MM = Target(high=0.1)


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Measure nexus at several steps, and with several hulls at 1 ms."""
    nexus = robot("nexus")
    engines = [DartEngine(nexus, dt_s, "near") for dt_s in STEPS_S]
    errors = _errors(duration_s)
    names = [f"{dt_s * 1e3:g} ms" for dt_s in STEPS_S]
    rows = [
        Row(name, figures | {"D_err mm": Figure.of(error * 1e3, "less")})
        for name, figures, error in zip(names, _figures(engines), errors, strict=True)
    ]
    how = (
        "nexus, near rollers; gains over the prediction from the rollers' geometry, within "
        "0.5 %; ripple: peak to peak height of the base; coasting: speed lost in a second "
        "without motor torque; time driving along all axes, interleaved, median of "
        f"{BLOCKS} blocks; D_err: {duration_s:g} s of the scenario back, one seed"
    )
    hulls = [DartEngine(_with_hull(nexus, spheres), 0.001, "near") for spheres in SPHERES]
    shapes = [
        Row(f"{spheres} spheres", figures)
        for spheres, figures in zip(SPHERES, _figures(hulls), strict=True)
    ]
    how_hulls = "the same at 1 ms, by the number of spheres in a roller's hull"
    return [
        Group("Convergence of the step", how, tuple(rows)),
        Group("Convergence of the hull", how_hulls, tuple(shapes)),
    ]


def _with_hull(mecanum: Robot, spheres: int) -> Robot:
    rollers = msgspec.structs.replace(mecanum.rollers, hull_spheres=spheres)
    return msgspec.structs.replace(mecanum, rollers=rollers)


def _figures(engines: Sequence[DartEngine]) -> list[dict[str, Figure]]:
    found = [measure_accuracy(engine) for engine in engines]
    times = measure_speed(engines, BLOCKS)
    lateral, yaw = lateral_gain(engines[0].robot), yaw_gain(engines[0].robot)
    return [
        {
            "ripple mm": Figure.of(accuracy.ripple * 1e3, RIPPLE_MM),
            "forward": Figure.of(accuracy.forward, GAIN),
            "lateral": Figure.of(accuracy.lateral / lateral, GAIN),
            "yaw": Figure.of(accuracy.yaw / yaw, GAIN),
            "coasting %/s": Figure.of(100.0 * (1.0 - math.sqrt(1.0 + accuracy.energy)), "less"),
            "× real time": Figure.of(engine.dt_s / statistics.median(seconds), "more"),
        }
        for engine, accuracy, seconds in zip(engines, found, times, strict=True)
    ]


def _errors(duration_s: float) -> list[float]:
    """Return D_err [m] at each of `STEPS_S`."""
    case = Case(name="back", scenario=SCENARIOS / "back.toml")
    jobs: list[Job] = []
    for dt_s in STEPS_S:
        settings = (f"sim.duration_s={duration_s}", f"physics.dt_s={dt_s}")
        (series,) = expand([case], (1,), settings)
        jobs += series.jobs
    with TemporaryDirectory() as folder, closing(Store(Path(folder) / "steps.sqlite")) as store:
        records = run_all(jobs, store, LocalWorkers(1))
    return [records[job.key].scores.whole.d_err_m or math.nan for job in jobs]
