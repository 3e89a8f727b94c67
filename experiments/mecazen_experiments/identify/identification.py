"""Identifies kinematics, the offset of two clocks, and motors; writes report and robot file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
import tomli_w
from mecazen.robot import Robot
from mecazen.rollers import lateral_gain
from mecazen_tools.statistics import Interval
from scipy.optimize import minimize_scalar

from mecazen_experiments.identify.data import MotorLog, Run
from mecazen_experiments.identify.models import (
    Fit,
    Model,
    Unit,
    ambiguities,
    covariance,
    estimates,
    fit,
)
from mecazen_experiments.identify.motors import identify_motors
from mecazen_experiments.identify.windows import (
    Moments,
    blocks,
    check_wheels,
    moments,
    total,
)

ROLLER_COUNTS = range(5, 13)
"""Hypotheses on the number of rollers."""
MAX_OFFSET_S = 0.2
"""Maximum offset of the two clocks in the search."""
OFFSET_RUNS = 24
"""Number of runs from which the offset of the clocks is estimated."""


@dataclass(frozen=True)
class Identification:
    """The result of an identification."""

    robot: str
    runs: int
    sessions: int
    duration_s: float
    offset_s: Interval
    """Offset of the reference's clock ahead of that of the wheels."""
    fits: tuple[Fit, ...]
    """Ideal kinematics, those of a number of rollers, and those with a free lateral gain."""
    parameters: tuple[Mapping[str, Interval], ...]
    """The parameters of each fit."""
    rollers: int
    """Number of rollers whose lateral gain is nearest to the free one."""
    motors: Mapping[str, Interval]
    """Parameters of the motors, if commands are recorded."""
    notes: tuple[str, ...]
    """Sentences on gaps, and on parameters that the data do not determine."""

    @property
    def geometry(self) -> Fit:
        """The fit with the lateral gain of a number of rollers."""
        return self.fits[1]


def identify(robot: Robot, runs: Sequence[Run], logs: Sequence[MotorLog] = ()) -> Identification:
    """Identify a robot from runs, and from logs of its motors.

    Raises:
        ConfigError: Columns of the wheels are swapped, or have a wrong unit.
    """
    for session in sessions(runs):
        check_wheels(session, total(moments(r) for r in runs if r.session == session), robot)
    offset = clock_offset(robot, runs)
    units = run_units(runs, offset.mean)
    independent = independent_units(runs, units, offset.mean)
    free = fit(Model("lateral gain free", robot), units)
    gain = free.by_name["lateral_gain"]
    count = min(ROLLER_COUNTS, key=lambda count: abs(lateral_gain(count) - gain))
    geometry = Model(f"geometry, {count} rollers", robot, lateral_gain(count))
    fits = (fit(Model("ideal, calibrated", robot, 1.0), units), fit(geometry, units), free)
    motors, motor_notes = identify_motors(logs) if logs else ({}, ())
    return Identification(
        robot.name,
        len(runs),
        len(sessions(runs)),
        math.fsum(float(run.times[-1] - run.times[0]) for run in runs),
        offset,
        fits,
        tuple(estimates(fitted, independent) for fitted in fits),
        count,
        motors,
        (*gap_lines(runs), *ambiguities([*free.by_name], covariance(free.slopes)), *motor_notes),
    )


def gap_lines(runs: Sequence[Run]) -> list[str]:
    """Return a line on each run with gaps."""
    return [
        f"{run.name}: {len(run.gaps)} gaps of up to {np.diff(run.times).max():.3g} s; windows with "
        "a gap are left out"
        for run in runs
        if run.gaps
    ]


def sessions(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the names of the sessions in order."""
    return tuple(sorted({run.session for run in runs}))


def run_units(runs: Sequence[Run], offset_s: float) -> list[Unit]:
    """Return group and moments of each run."""
    return [(run.group, moments(run, offset_s)) for run in runs]


def independent_units(runs: Sequence[Run], units: Sequence[Unit], offset_s: float) -> list[Unit]:
    """Return group and moments of each session; of a single one, those of its blocks."""
    by_session: dict[tuple[str, str], list[Moments]] = {}
    for run, (group, part) in zip(runs, units, strict=True):
        by_session.setdefault((run.session, group), []).append(part)
    if len(by_session) == 1:
        return [(run.group, part) for run in runs for part in blocks(run, offset_s)]
    return [(group, total(parts)) for (_, group), parts in by_session.items()]


def clock_offset(robot: Robot, runs: Sequence[Run]) -> Interval:
    """Return the offset by which the reference's clock is ahead of that of the wheels."""
    chosen = runs[:: math.ceil(len(runs) / OFFSET_RUNS)]

    def cost(offset_s: float) -> float:
        units = run_units(chosen, offset_s)
        windows = sum(part.count for _, part in units)
        return -fit(Model("lateral gain free", robot), units).log_likelihood / windows

    best = float(
        minimize_scalar(cost, bounds=(-MAX_OFFSET_S, MAX_OFFSET_S), options={"xatol": 1e-4}).x
    )
    step = 0.01
    windows = sum(part.count for _, part in run_units(chosen, 0.0))
    bend = windows * (cost(best + step) + cost(best - step) - 2.0 * cost(best)) / step**2
    half = 1.96 / math.sqrt(bend) if bend > 0.0 else math.inf
    return Interval(best, best - half, best + half, windows)


def robot_file(robot: Robot, result: Identification) -> str:
    """Return an identified robot as a robot file."""
    tables = {k: v for k, v in msgspec.to_builtins(robot).items() if v is not None}
    return (
        f"# Identified by `mecazen identify` from {result.runs} runs; all other values are those "
        f"of {result.robot}.\n{tomli_w.dumps(tables)}"
    )


def identification_lines(result: Identification) -> Iterator[str]:
    """Yield the report of an identification as Markdown."""
    yield f"# Identification of {result.robot}\n"
    yield (
        f"{result.runs} runs of {result.sessions} sessions, {result.duration_s / 60.0:.0f} "
        f"min. The reference's clock is {interval(result.offset_s, '.5g', 1e3)} ms ahead of the "
        "wheels'.\n"
    )
    yield from (f"- {note}" for note in result.notes)
    yield "\n## Kinematics\n"
    yield from table_lines(
        ("parameter, with the 95 % interval", *(fitted.model.name for fitted in result.fits)),
        (
            [name, *(_cell(parameters, name) for parameters in result.parameters)]
            for name in result.parameters[-1]
        ),
    )
    gains = ", ".join(f"{lateral_gain(count):.4f} (N = {count})" for count in ROLLER_COUNTS)
    yield (
        f"\nIntervals are over sessions, or over blocks of a single session. Wheels of N rollers "
        f"have the lateral gain {gains}. Slip, or rollers that give way, would look like fewer "
        "rollers."
    )
    if result.motors:
        yield "\n## Motors\n"
        yield from table_lines(
            ("parameter", "value, 95 % interval by the curvature"),
            ([name, interval(value, ".5g")] for name, value in result.motors.items()),
        )


def interval(value: Interval, form: str, scale: float = 1.0) -> str:
    """Return a value with its interval, or with both values of two; a single one has none."""
    mean, low, high = (f"{scale * each:{form}}" for each in (value.mean, *value.ends))
    return mean if value.n == 1 else f"{mean} ({low}{', ' if value.n == 2 else ' to '}{high})"


def _cell(parameters: Mapping[str, Interval], name: str) -> str:
    return interval(parameters[name], ".5g") if name in parameters else ""


def table_lines(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    for row in (header, ["---"] * len(header), *rows):
        yield f"| {' | '.join(row)} |"
