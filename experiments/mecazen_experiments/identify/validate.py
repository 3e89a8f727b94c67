"""Validation: fits models to some sessions of a real robot, and compares their drift on all others.

The unit of independence is a session: its runs share the floor, the mounting and the battery.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat

import numpy as np
from mecazen.errors import ConfigError
from mecazen.robot import Robot
from mecazen_tools.pool import CORES, processes
from mecazen_tools.statistics import Interval

from mecazen_experiments.identify.data import Array, Run
from mecazen_experiments.identify.identification import Identification, identify, sessions
from mecazen_experiments.identify.simulate import identified_robot, simulated
from mecazen_experiments.identify.windows import (
    drifts,
    ideal_matrix,
    in_reference,
    mounted,
    odometry,
)
from mecazen_experiments.statistics import jackknife

HORIZON_S = 10.0
"""Time after which drift is measured."""

Drifts = dict[tuple[str, str], list[Interval]]
"""Median and 95th percentile of the drift in position [m], then in yaw [rad], with intervals over
sessions, by model and kind of path."""


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


def validate(robot: Robot, runs: Sequence[Run]) -> tuple[Identification, Robot, Drifts]:
    """Return what is identified from some sessions, the robot, and the drift on the others."""
    fitted, held_out = split(runs)
    result = identify(robot, fitted)
    changed = identified_robot(robot, result, fitted[0])
    nominal = in_reference(ideal_matrix(robot, robot.wheels.radius_m, robot.lever), np.zeros(3))
    paths = {"nominal": [odometry(run, nominal) for run in held_out]}
    for kinematics in result.fits:
        paths[kinematics.model.name] = [
            odometry(run, kinematics.coefficients(run.group)) for run in held_out
        ]
    with processes(min(CORES, len(held_out))) as pool:
        driven = list(pool.map(simulated, repeat(changed), held_out))
    paths["full physics"] = [
        mounted(poses, result.geometry.mounting(run.group))
        for run, poses in zip(held_out, driven, strict=True)
    ]
    drift = {
        (model, kind): _drift(held_out, poses, kind)
        for kind in sorted({run.path for run in held_out})
        for model, poses in paths.items()
    }
    return result, changed, drift


def _drift(runs: Sequence[Run], poses: Sequence[Array], kind: str) -> list[Interval]:
    """Return the drift of predicted poses of runs on one kind of path."""
    by_session: dict[str, list[Array]] = {}
    for run, path in zip(runs, poses, strict=True):
        if run.path == kind:
            by_session.setdefault(run.session, []).append(drifts(run, path, HORIZON_S))

    def statistics(parts: Sequence[Array]) -> list[float]:
        return np.percentile(np.concatenate(parts), [50.0, 95.0], axis=0).T.ravel().tolist()

    return jackknife(statistics, [np.concatenate(each) for each in by_session.values()])
