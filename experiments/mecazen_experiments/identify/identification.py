"""Identifies the kinematics of a robot: models, their likelihood, and undetermined parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mecazen.robot import Robot
from mecazen_tools.statistics import Interval, mean_interval
from scipy.optimize import minimize_scalar

from mecazen_experiments.identify.data import MotorLog, Run
from mecazen_experiments.identify.models import (
    ROLLER_COUNTS,
    Unit,
    estimates,
    fit,
    ideal,
    lateral,
    rollers,
)
from mecazen_experiments.identify.motors import identify_motors
from mecazen_experiments.identify.windows import (
    Moments,
    blocks,
    check_wheels,
    gains,
    moments,
    total,
)
from mecazen_experiments.statistics import jackknife

MAX_OFFSET_S = 0.2
"""Maximum offset of the two clocks in the search."""
OFFSET_RUNS = 24
"""Number of runs from which the offset of the clocks is estimated."""


@dataclass(frozen=True)
class ModelResult:
    """A model's parameters, and sentences on those that are not determined."""

    parameters: Mapping[str, Interval]
    ambiguities: tuple[str, ...]


@dataclass(frozen=True)
class SessionResult:
    """A session: lateral over forward gain, and the share of time that is missing in its log."""

    session: str
    runs: int
    lateral_gain: Interval
    """The interval is over blocks of windows."""
    missing: float


@dataclass(frozen=True)
class Identification:
    """The result of an identification."""

    robot: str
    runs: int
    duration_s: float
    offset_s: Interval
    """Offset of the reference's clock ahead of that of the wheels."""
    models: Mapping[str, ModelResult]
    rollers: Mapping[int, Interval]
    """By number of rollers: log-likelihood of the most likely number minus that of this number, for
    all windows, with its interval over sessions."""
    sessions: tuple[SessionResult, ...]
    motors: Mapping[str, Interval]
    """Parameters of the motors, if commands are recorded."""
    notes: tuple[str, ...]

    @property
    def lateral_gain(self) -> Interval:
        """Lateral over forward gain: mean over sessions."""
        return mean_gain(self.sessions)

    @property
    def roller_count(self) -> int:
        """The most likely number of rollers."""
        return min(self.rollers, key=lambda count: self.rollers[count].mean)

    @property
    def geometry(self) -> ModelResult:
        """The model with the most likely number of rollers."""
        return self.models[f"geometry, {self.roller_count} rollers"]


def identify(robot: Robot, runs: Sequence[Run], logs: Sequence[MotorLog] = ()) -> Identification:
    """Identify a robot from runs, and from logs of its motors.

    Raises:
        ConfigError: Columns of the wheels are swapped, or have a wrong unit.
    """
    for session in sessions(runs):
        check_wheels(session, total(moments(r) for r in runs if r.session == session), robot)
    offset = clock_offset(robot, runs)
    units = run_units(runs, offset.mean)
    behind = _roller_counts(robot, runs, units)
    likeliest = rollers(robot, min(behind, key=lambda count: behind[count].mean))
    independent = independent_units(runs, units, offset.mean)
    models = (ideal(robot), likeliest, lateral(robot))
    motors, notes = identify_motors(logs) if logs else ({}, ())
    return Identification(
        robot.name,
        len(runs),
        math.fsum(float(run.times[-1] - run.times[0]) for run in runs),
        offset,
        {model.name: ModelResult(*estimates(fit(model, units), independent)) for model in models},
        behind,
        session_results(runs, offset.mean, robot),
        motors,
        (*gap_lines(runs), *notes),
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
        fitted = fit(lateral(robot), units)
        windows = sum(part.count for _, part in units)
        sums = {g: total(part for group, part in units if group == g) for g, _ in units}
        return -sum(fitted.log_likelihood(group, part) for group, part in sums.items()) / windows

    best = float(
        minimize_scalar(cost, bounds=(-MAX_OFFSET_S, MAX_OFFSET_S), options={"xatol": 1e-4}).x
    )
    step = 0.01
    windows = sum(part.count for _, part in run_units(chosen, 0.0))
    bend = windows * (cost(best + step) + cost(best - step) - 2.0 * cost(best)) / step**2
    half = 1.96 / math.sqrt(bend) if bend > 0.0 else math.inf
    return Interval(best, best - half, best + half, windows)


def _roller_counts(robot: Robot, runs: Sequence[Run], units: Sequence[Unit]) -> dict[int, Interval]:
    """Return how far each number of rollers, fitted to all runs, is behind the most likely one."""
    table = {}
    for count in ROLLER_COUNTS:
        fitted = fit(rollers(robot, count), units)
        by_session = dict.fromkeys(sessions(runs), 0.0)
        for run, (group, part) in zip(runs, units, strict=True):
            by_session[run.session] += fitted.log_likelihood(group, part)
        table[count] = [*by_session.values()]
    top = max(table.values(), key=math.fsum)
    return {
        count: mean_interval([len(top) * (a - b) for a, b in zip(top, scores, strict=True)])
        for count, scores in table.items()
    }


def session_results(
    runs: Sequence[Run], offset_s: float, robot: Robot
) -> tuple[SessionResult, ...]:
    """Return lateral over forward gain of each session, with its interval over blocks."""

    def ratio(parts: Sequence[Moments]) -> list[float]:
        forward, lateral, _ = gains(total(parts))[0].tolist()
        return [lateral / forward * robot.cross_gain]

    results = []
    for session in sessions(runs):
        chosen = [run for run in runs if run.session == session]
        (gain,) = jackknife(ratio, [part for run in chosen for part in blocks(run, offset_s)])
        missing = math.fsum(run.missing for run in chosen) / len(chosen)
        results.append(SessionResult(session, len(chosen), gain, missing))
    return tuple(results)


def mean_gain(results: Sequence[SessionResult]) -> Interval:
    """Return the mean of the lateral over forward gain over sessions; of one, its interval."""
    if len(results) == 1:
        return results[0].lateral_gain
    return mean_interval([result.lateral_gain.mean for result in results])
