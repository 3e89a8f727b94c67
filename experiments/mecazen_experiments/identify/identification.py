"""Identifies the kinematics of a robot: models, their likelihood, and undetermined parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from mecazen.robot import Robot
from scipy.optimize import minimize_scalar

from mecazen_experiments.identify.fit import (
    Estimate,
    Fit,
    Grouped,
    Noise,
    estimates,
    fit,
)
from mecazen_experiments.identify.models import (
    ROLLER_COUNTS,
    Model,
    Nominal,
    families,
    lateral,
    rollers,
)
from mecazen_experiments.identify.motors import MotorLog, identify_motors
from mecazen_experiments.identify.runs import Array, Run, run_lines
from mecazen_experiments.identify.wheels import check_wheels, gains, mounting
from mecazen_experiments.identify.windows import Moments, cut, total
from mecazen_experiments.statistics import Interval, jackknife, mean_interval

WINDOW_S = 0.5
"""Duration of a window: long enough for motion far beyond the reference's noise, short enough for
little yaw."""
MAX_OFFSET_S = 0.2
"""Maximum offset of the two clocks in the search."""
BLOCK = 20
"""Number of windows of a block: residuals of neighbours are not independent."""
OFFSET_RUNS = 24
"""Number of runs from which the offset of the clocks is estimated."""


@dataclass(frozen=True)
class ModelResult:
    """A model: its parameters, and its likelihood on held-out runs."""

    name: str
    parameters: Mapping[str, Estimate]
    noise: Mapping[str, Noise]
    held_out: float
    """Mean log-likelihood of a held-out window; NaN with a single run."""
    behind: Interval | None
    """Log-likelihood of the most likely model minus that of this model, per held-out window, over
    sessions."""
    ambiguities: tuple[str, ...]


@dataclass(frozen=True)
class RollerResult:
    """A hypothesis on the number of rollers."""

    count: int
    behind: Interval
    """Log-likelihood of the most likely number minus that of this number, for all windows, with its
    interval over sessions."""


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
    offset_s: Estimate
    """Offset of the reference's clock ahead of that of the wheels."""
    models: tuple[ModelResult, ...]
    rollers: tuple[RollerResult, ...]
    sessions: tuple[SessionResult, ...]
    motors: Mapping[str, Estimate]
    """Parameters of the motors, if commands are recorded."""
    notes: tuple[str, ...]

    @property
    def lateral_gain(self) -> Interval:
        """Lateral over forward gain: mean over sessions."""
        return mean_gain(self.sessions)

    @property
    def roller_count(self) -> int:
        """The most likely number of rollers."""
        return min(self.rollers, key=lambda one: one.behind.mean).count

    def model(self, name: str) -> ModelResult:
        """Return a model by its name."""
        return next(one for one in self.models if one.name == name)


def identify(robot: Robot, runs: Sequence[Run], logs: Sequence[MotorLog] = ()) -> Identification:
    """Identify a robot from runs, and from logs of its motors.

    Raises:
        ConfigError: Columns of the wheels are swapped, or have a wrong unit.
    """
    nominal = Nominal.of(robot)
    runs, turned = turned_back(runs)
    for session in sessions(runs):
        own = [run for run in runs if run.session == session]
        check_wheels(session, total(Moments.of(cut(run, WINDOW_S)) for run in own), nominal)
    offset = clock_offset(nominal, runs)
    moments = [Moments.of(cut(run, WINDOW_S, offset.value)) for run in runs]
    grouped = group(runs, moments)
    units = _units(runs, moments, offset.value)
    counted = [rollers(nominal, count) for count in ROLLER_COUNTS]
    scores = {m.name: held_out(m, runs, moments) for m in (*families(nominal), *counted)}
    hypotheses = _hypotheses(counted, runs, moments)
    best_count = min(hypotheses, key=lambda one: one.behind.mean).count
    models = sorted((*families(nominal), rollers(nominal, best_count)), key=lambda m: len(m.start))
    best = max(models, key=lambda m: _mean(scores[m.name], moments)).name
    results = []
    for model in models:
        found = fit(model, grouped)
        parameters, ambiguities = estimates(found, units)
        score, top = scores[model.name], scores[best]
        behind = _by_session(runs, moments, top - score)
        results.append(
            ModelResult(
                model.name,
                parameters,
                found.noise,
                _mean(score, moments),
                mean_interval(list(behind.values())) if np.isfinite(score).all() else None,
                ambiguities,
            )
        )
    by_session = session_results(runs, offset.value, nominal)
    motors, notes = identify_motors(logs) if logs else ({}, ())
    return Identification(
        robot.name,
        len(runs),
        math.fsum(float(run.times[-1] - run.times[0]) for run in runs),
        offset,
        tuple(results),
        tuple(hypotheses),
        by_session,
        motors,
        (*run_lines(runs), *turned, *notes),
    )


def turned_back(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Return the runs without turns of the reference of more than 45°, and a line on each turn."""
    grouped = group(runs, [Moments.of(cut(run, WINDOW_S)) for run in runs])
    turns = {name: mounting(total(parts)) for name, parts in grouped.items()}
    lines = [
        f"{name or runs[0].name}: the reference is turned by {math.degrees(turn):.1f}° on the "
        "robot; misalignment and offset are relative to this angle"
        for name, turn in turns.items()
        if turn
    ]
    return [replace(run, poses=run.poses - [0.0, 0.0, turns[run.group]]) for run in runs], lines


def sessions(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the names of the sessions in order."""
    return tuple(sorted({run.session for run in runs}))


def group(runs: Sequence[Run], moments: Sequence[Moments]) -> Grouped:
    """Return the moments of runs by their groups."""
    found: dict[str, list[Moments]] = {}
    for run, one in zip(runs, moments, strict=True):
        found.setdefault(run.group, []).append(one)
    return found


def clock_offset(nominal: Nominal, runs: Sequence[Run]) -> Estimate:
    """Return the offset by which the reference's clock is ahead of that of the wheels."""
    chosen = runs[:: math.ceil(len(runs) / OFFSET_RUNS)]

    def cost(offset_s: float) -> float:
        moments = [Moments.of(cut(run, WINDOW_S, offset_s)) for run in chosen]
        grouped = group(chosen, moments)
        found = fit(lateral(nominal), grouped)
        windows = sum(one.count for one in moments)
        return -sum(found.log_likelihood(g, total(of)) for g, of in grouped.items()) / windows

    best = float(
        minimize_scalar(cost, bounds=(-MAX_OFFSET_S, MAX_OFFSET_S), options={"xatol": 1e-4}).x
    )
    step = 0.01
    windows = sum(len(run.starts(round(WINDOW_S / run.period_s))) for run in chosen)
    bend = windows * (cost(best + step) + cost(best - step) - 2.0 * cost(best)) / step**2
    half = 1.96 / math.sqrt(bend) if bend > 0.0 else math.inf
    return Estimate(best, best - half, best + half, half)


def folds(runs: Sequence[Run]) -> list[int]:
    """Return 0 or 1 for each run, alternating by session, or by run in groups with one session."""
    result = []
    for run in runs:
        own = [other for other in runs if other.group == run.group]
        units = sessions(own)
        if len(units) > 1:
            result.append(units.index(run.session) % 2)
        else:
            result.append(own.index(run) % 2)
    return result


def held_out(model: Model, runs: Sequence[Run], moments: Sequence[Moments]) -> Array:
    """Return the log-likelihood of each run under the fit to the other half; NaN without a fit."""
    fold = np.array(folds(runs))
    result = np.full(len(runs), math.nan)
    for side in (0, 1):
        fitted = [index for index in range(len(runs)) if fold[index] != side]
        if not fitted:
            continue
        found = fit(model, group([runs[i] for i in fitted], [moments[i] for i in fitted]))
        for index in np.flatnonzero(fold == side).tolist():
            if runs[index].group in found.groups:
                result[index] = found.log_likelihood(runs[index].group, moments[index])
    return result


def _mean(score: Array, moments: Sequence[Moments]) -> float:
    return float(score.sum() / sum(one.count for one in moments))


def _by_session(runs: Sequence[Run], moments: Sequence[Moments], score: Array) -> dict[str, float]:
    """Return the mean of a score per window in each session."""
    result = {}
    for session in sessions(runs):
        own = [index for index, run in enumerate(runs) if run.session == session]
        windows = sum(moments[index].count for index in own)
        result[session] = math.fsum(float(score[index]) for index in own) / windows
    return result


def _hypotheses(
    models: Sequence[Model], runs: Sequence[Run], moments: Sequence[Moments]
) -> list[RollerResult]:
    """Return the hypotheses on the number of rollers, each fitted to all runs."""
    grouped = group(runs, moments)
    table = []
    for model in models:
        found: Fit = fit(model, grouped)
        by_session = dict.fromkeys(sessions(runs), 0.0)
        for run, one in zip(runs, moments, strict=True):
            by_session[run.session] += found.log_likelihood(run.group, one)
        table.append([*by_session.values()])
    top = max(table, key=math.fsum)
    return [
        RollerResult(
            count,
            mean_interval([len(top) * (a - b) for a, b in zip(top, scores, strict=True)]),
        )
        for count, scores in zip(ROLLER_COUNTS, table, strict=True)
    ]


def session_results(
    runs: Sequence[Run], offset_s: float, nominal: Nominal
) -> tuple[SessionResult, ...]:
    """Return the lateral over forward gain of each session."""
    return tuple(_session(runs, offset_s, name, nominal) for name in sessions(runs))


def mean_gain(results: Sequence[SessionResult]) -> Interval:
    """Return the mean of the lateral over forward gain over sessions; of one, its interval."""
    if len(results) == 1:
        return results[0].lateral_gain
    return mean_interval([one.lateral_gain.mean for one in results])


def _session(runs: Sequence[Run], offset_s: float, name: str, nominal: Nominal) -> SessionResult:
    """Return lateral over forward gain of a session, with its interval over blocks of windows."""
    own = [run for run in runs if run.session == name]

    def ratio(blocks: Sequence[tuple[str, Moments]]) -> list[float]:
        found, _ = gains(total(part for _, part in blocks))
        return [float(found[1] / found[0] * nominal.cross_gain)]

    (gain,) = jackknife(ratio, _blocks(own, offset_s))
    return SessionResult(name, len(own), gain, math.fsum(run.missing for run in own) / len(own))


def _units(
    runs: Sequence[Run], moments: Sequence[Moments], offset_s: float
) -> list[tuple[str, Moments]]:
    """Return group and moments of each session; of a single one, those of its blocks."""
    by_session: dict[tuple[str, str], list[Moments]] = {}
    for run, part in zip(runs, moments, strict=True):
        by_session.setdefault((run.session, run.group), []).append(part)
    if len(by_session) == 1:
        return _blocks(runs, offset_s)
    return [(name, total(parts)) for (_, name), parts in by_session.items()]


def _blocks(runs: Sequence[Run], offset_s: float) -> list[tuple[str, Moments]]:
    """Return group and moments of each block of windows."""
    return [
        (run.group, Moments.of(block))
        for run in runs
        for block in cut(run, WINDOW_S, offset_s).blocks(BLOCK)
    ]


def best_geometry(found: Identification) -> ModelResult:
    """Return the model with the most likely number of rollers."""
    return found.model(f"geometry, {found.roller_count} rollers")


Residuals = Mapping[str, Array]
"""Residuals of all windows of each group: x [m], y [m], yaw [rad] (m, 3)."""


def residuals(robot: Robot, runs: Sequence[Run], found: Identification) -> Residuals:
    """Return the residuals of the model with the most likely number of rollers."""
    runs, _ = turned_back(runs)
    windows = [cut(run, WINDOW_S, found.offset_s.value) for run in runs]
    model = rollers(Nominal.of(robot), found.roller_count)
    fitted = fit(model, group(runs, [Moments.of(one) for one in windows]))
    result: dict[str, list[Array]] = {}
    for run, one in zip(runs, windows, strict=True):
        result.setdefault(run.group, []).append(one.residuals(fitted.coefficients(run.group)))
    return {name: np.concatenate(parts) for name, parts in sorted(result.items())}
