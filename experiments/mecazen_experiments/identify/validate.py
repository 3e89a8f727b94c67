"""Validation: fits models to some sessions of a real robot, and reports the drift on all others.

The unit of independence is a session: its runs share the floor, the mounting and the battery.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mecazen.errors import ConfigError
from mecazen.robot import Robot
from mecazen_tools.statistics import Interval

from mecazen_experiments.identify.data import Array, Run
from mecazen_experiments.identify.identification import (
    Identification,
    identify,
    run_units,
    sessions,
)
from mecazen_experiments.identify.models import fit, ideal, lateral, rollers
from mecazen_experiments.identify.simulate import all_simulated, identified_robot, mounted
from mecazen_experiments.identify.windows import drifts, ideal_matrix, in_reference, odometry
from mecazen_experiments.statistics import jackknife

HORIZON_S = 10.0
"""Time after which drift is measured."""


class Drift(NamedTuple):
    """Drift of a model over all spans of the held-out runs of a kind of path.

    The intervals are over sessions.
    """

    position_median_m: Interval
    position_p95_m: Interval
    yaw_median_rad: Interval
    yaw_p95_rad: Interval


@dataclass(frozen=True)
class Validation:
    """The result of a validation."""

    fitted: tuple[str, ...]
    """Sessions for fitting."""
    held_out: tuple[str, ...]
    drifts: Mapping[tuple[str, str], Drift]
    """By model and kind of path."""
    identification: Identification
    """Identification from the sessions for fitting only."""


def split(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """Return the runs for fitting, and all others.

    The sessions for fitting have odd positions, counted from 1, in the sorted list of each kind of
    path.

    Raises:
        ConfigError: No kind of path has a second session.
    """
    chosen: set[str] = set()
    for path in {run.path for run in runs}:
        chosen.update(sessions([run for run in runs if run.path == path])[::2])
    fitted = [run for run in runs if run.session in chosen]
    held_out = [run for run in runs if run.session not in chosen]
    if not held_out:
        names = ", ".join(sorted(chosen))
        raise ConfigError(f"--validate needs a second session of a kind of path; there are {names}")
    groups = {run.group for run in fitted}
    if lacking := [run.name for run in held_out if run.group not in groups]:
        raise ConfigError(f"{lacking[0]}: no session for fitting has its markers")
    return fitted, held_out


def validate(robot: Robot, runs: Sequence[Run]) -> tuple[Validation, Robot]:
    """Fit on some sessions, and return the drift on the others and the identified robot."""
    fitted, held_out = split(runs)
    identification = identify(robot, fitted)
    offset_s, count = identification.offset_s.mean, identification.roller_count
    changed = identified_robot(robot, identification.geometry.parameters, count, fitted[0])
    units = run_units(fitted, offset_s)
    geometry = fit(rollers(robot, count), units)
    nominal = ideal_matrix(robot, robot.wheels.radius_m, robot.lever)
    coefficients = in_reference(nominal, np.zeros(3))
    paths = {"nominal": [odometry(run, coefficients) for run in held_out]}
    for kinematics in (fit(ideal(robot), units), geometry, fit(lateral(robot), units)):
        paths[kinematics.model.name] = [
            odometry(run, kinematics.coefficients(run.group)) for run in held_out
        ]
    paths["full physics"] = [
        mounted(poses, geometry.mounting(run.group))
        for run, poses in zip(held_out, all_simulated(changed, held_out), strict=True)
    ]
    return Validation(
        sessions(fitted),
        sessions(held_out),
        {
            (model, kind): _drift(held_out, poses, kind)
            for kind in sorted({run.path for run in held_out})
            for model, poses in paths.items()
        },
        identification,
    ), changed


def _drift(runs: Sequence[Run], poses: Sequence[Array], kind: str) -> Drift:
    """Return the drift of predicted poses of runs on one kind of path."""
    by_session: dict[str, list[Array]] = {}
    for run, path in zip(runs, poses, strict=True):
        if run.path == kind:
            by_session.setdefault(run.session, []).append(drifts(run, path, HORIZON_S))

    def statistics(parts: Sequence[Array]) -> list[float]:
        return np.percentile(np.concatenate(parts), [50.0, 95.0], axis=0).T.ravel().tolist()

    return Drift(*jackknife(statistics, [np.concatenate(each) for each in by_session.values()]))
