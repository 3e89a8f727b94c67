"""Validation: fits models to some sessions of a real robot, and reports the drift on all others.

The unit of independence is a session: its runs share the floor, the mounting and the battery.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from mecazen.loading import load_table
from mecazen.robot import Robot
from mecazen.schema import Positive, Section
from scipy.optimize import least_squares

from mecazen_experiments.identify.drift import drifts, integrated, odometry
from mecazen_experiments.identify.fit import Fit, fit
from mecazen_experiments.identify.identification import (
    WINDOW_S,
    Identification,
    SessionResult,
    best_geometry,
    group,
    identify,
    session_results,
    sessions,
)
from mecazen_experiments.identify.models import (
    FRAME,
    Model,
    Nominal,
    full,
    ideal,
    lateral,
    nominal,
    rollers,
)
from mecazen_experiments.identify.runs import Array, Run
from mecazen_experiments.identify.simulated import all_simulated, identified_robot, mounted
from mecazen_experiments.identify.windows import Moments, cut, motions
from mecazen_experiments.statistics import Interval, jackknife

IDEAL, PHYSICS = "ideal, calibrated", "full physics"


class ValidateConfig(Section):
    """The configuration of a validation."""

    robot: Path
    """The robot file, relative to the configuration file."""
    fit: Literal["odd", "even"] = "odd"
    """Positions, counted from 1, of the sessions for fitting in the sorted list of each kind of
    path."""
    horizons_s: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)] = (1.0, 5.0, 10.0)
    """Times after which drift is measured; models are compared in pairs at the last time."""
    segment_s: Positive = 10.0
    """Length of the segments at whose ends OptiOdom's method compares positions."""


@dataclass(frozen=True)
class Drift:
    """Drift of a model after a time, over all spans of the held-out runs of a kind of path.

    The intervals are over sessions.
    """

    model: str
    kind: str
    horizon_s: float
    sessions: int
    spans: int
    position_median_m: Interval
    position_p95_m: Interval
    yaw_median_rad: Interval
    yaw_p95_rad: Interval


@dataclass(frozen=True)
class Difference:
    """Median drift of a model minus that of another after the longest time, in pairs [m]."""

    model: str
    other: str
    kind: str
    sessions: int
    position_m: Interval


@dataclass(frozen=True)
class Validation:
    """The result of a validation."""

    fitted: tuple[str, ...]
    """Sessions for fitting."""
    held_out: tuple[str, ...]
    drifts: tuple[Drift, ...]
    differences: tuple[Difference, ...]
    identification: Identification
    """Identification from the sessions for fitting only."""
    sessions: tuple[SessionResult, ...]
    """Lateral gain of all sessions."""
    duration_s: float
    """Duration of the held-out runs [s]."""


def split(runs: Sequence[Run], config: ValidateConfig) -> tuple[list[Run], list[Run]]:
    """Return the runs for fitting, and all others."""
    chosen: set[str] = set()
    for kind in sorted({run.kind for run in runs}):
        names = sessions([run for run in runs if run.kind == kind])
        chosen.update(names[0 if config.fit == "odd" else 1 :: 2])
    return (
        [run for run in runs if run.session in chosen],
        [run for run in runs if run.session not in chosen],
    )


def load(path: Path) -> tuple[ValidateConfig, Robot]:
    """Return a validation and its robot."""
    config = load_table(path, ValidateConfig)
    return config, load_table(path.parent / config.robot, Robot)


def validate(config: ValidateConfig, robot: Robot, runs: Sequence[Run]) -> tuple[Validation, Robot]:
    """Fit on some sessions, and return the drift on the others and the identified robot."""
    fitted, others = split(runs, config)
    found = identify(robot, fitted)
    offset_s, count = found.offset_s.value, found.roller_count
    changed = identified_robot(robot, best_geometry(found).parameters, count, fitted[0])
    start = Nominal.of(robot)
    geometry = rollers(start, count)
    fits = {
        model.name: _fitted(model, fitted, offset_s)
        for model in (nominal(start), ideal(start), geometry, lateral(start), full(start))
    }
    logged = [run.as_logged() for run in fitted]
    unmodelled = _fitted(geometry, logged, offset_s)
    segments = optiodom(start, fitted, config.segment_s)
    best = fits[geometry.name]
    poses: dict[str, Callable[[int, Run], Array]] = {
        "nominal, as logged": lambda _, run: _odometry(fits["nominal"], run.as_logged()),
        "nominal": lambda _, run: _odometry(fits["nominal"], run),
        IDEAL: lambda _, run: _odometry(fits[IDEAL], run),
        "OptiOdom's method": lambda _, run: odometry(run, segments),
        f"{geometry.name}, as logged": lambda _, run: _odometry(unmodelled, run.as_logged()),
        geometry.name: lambda _, run: _odometry(best, run),
        "lateral gain free": lambda _, run: _odometry(fits["lateral gain free"], run),
        "full 3 × 4": lambda _, run: _odometry(fits["full 3 × 4"], run),
    }
    driven = all_simulated(changed, others)
    poses[PHYSICS] = lambda index, run: mounted(driven[index], _mounting(best, run.group))
    table: dict[tuple[str, str, float], dict[str, list[Array]]] = {}
    for index, run in enumerate(others):
        for name, of in poses.items():
            path = of(index, run)
            for horizon in config.horizons_s:
                own = table.setdefault((name, run.kind, horizon), {})
                own.setdefault(run.session, []).append(drifts(run, path, horizon))
    joined = {
        key: {session: np.concatenate(parts) for session, parts in own.items()}
        for key, own in table.items()
    }
    return (
        Validation(
            sessions(fitted),
            sessions(others),
            tuple(_drift(*key, own) for key, own in joined.items()),
            tuple(_differences(joined, geometry.name, config.horizons_s[-1])),
            found,
            session_results(runs, offset_s, start),
            math.fsum(float(run.times[-1] - run.times[0]) for run in others),
        ),
        changed,
    )


def optiodom(start: Nominal, runs: Sequence[Run], segment_s: float) -> Array:
    """Return the coefficients that OptiOdom's method finds (14,).

    The method optimises the diameter of each wheel and the lever of the ideal kinematics. It
    minimises the distances between the positions of odometry and reference at the ends of segments
    of runs, which begin at the reference's pose (R. B. Sousa et al., J. Intell. Robot. Syst.
    105:39, 2022). Its resilient propagation is replaced by least squares, with the same minimum.
    """

    def coefficients(values: Array) -> Array:
        matrix = start.matrix(1.0, values[4]) * values[:4]
        return np.concatenate([matrix.ravel(), np.zeros(2)])

    prepared = []
    for run in runs:
        size = round(segment_s / run.period_s)
        first = run.starts(size)
        prepared.append((np.diff(run.wheels, axis=0), first, size, motions(run.poses, first, size)))

    def residuals(values: Array) -> Array:
        matrix = coefficients(values)[:12].reshape(3, 4)
        return np.concatenate(
            [
                (motions(integrated(steps @ matrix.T), first, size) - moved)[:, :2].ravel()
                for steps, first, size, moved in prepared
            ]
        )

    begin = np.array([*[start.radius] * 4, start.lever])
    return coefficients(least_squares(residuals, begin, x_scale="jac").x)


def _fitted(model: Model, runs: Sequence[Run], offset_s: float) -> Fit:
    return fit(model, group(runs, [Moments.of(cut(run, WINDOW_S, offset_s)) for run in runs]))


def _odometry(found: Fit, run: Run) -> Array:
    return odometry(run, found.coefficients(run.group))


def _mounting(found: Fit, name: str) -> Array:
    """Return misalignment [rad] and offset [m] of a group of runs (3,)."""
    at = len(found.model.parameters) + len(FRAME) * found.groups.index(name)
    return found.values[at : at + len(FRAME)]


def _drift(model: str, kind: str, horizon_s: float, own: Mapping[str, Array]) -> Drift:
    def statistics(values: Sequence[Array]) -> list[float]:
        # median and 95th percentile of position, then of yaw
        found: Array = np.percentile(np.concatenate(values), [50.0, 95.0], axis=0)
        return found.T.ravel().tolist()

    values = list(own.values())
    spans = sum(map(len, values))
    return Drift(model, kind, horizon_s, len(own), spans, *jackknife(statistics, values))


def _differences(
    joined: Mapping[tuple[str, str, float], Mapping[str, Array]], geometry: str, horizon_s: float
) -> list[Difference]:
    """Return the differences geometry minus ideal kinematics, and physics minus geometry."""
    kinds = list(dict.fromkeys(kind for _, kind, _ in joined))
    result = []
    for model, other in ((geometry, IDEAL), (PHYSICS, geometry)):
        pairs = {
            kind: [
                np.stack(
                    [joined[name, kind, horizon_s][s][:, 0] for name in (model, other)], axis=1
                )
                for s in joined[model, kind, horizon_s]
            ]
            for kind in kinds
        }
        for kind, values in pairs.items():
            result.append(Difference(model, other, kind, len(values), *jackknife(_lead, values)))
        every = [values for kind in kinds for values in pairs[kind]]
        result.append(Difference(model, other, "all", len(every), *jackknife(_lead, every)))
    return result


def _lead(values: Sequence[Array]) -> list[float]:
    first, second = np.median(np.concatenate(values), axis=0)
    return [float(first - second)]
