"""The identified robot in full simulation, and its validation beside the models.

A validation fits models to some sessions, and compares their drift on all others. The unit of
independence is a session: its runs share the floor, the mounting and the battery.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import repeat

import msgspec
import numpy as np
from mecazen.config import PhysicsConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.robot import RealMotors, Robot
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation
from mecazen_tools.pool import CORES, processes
from mecazen_tools.statistics import Interval

from mecazen_experiments.identify.data import Array, Run
from mecazen_experiments.identify.identification import (
    Identification,
    identify,
    interval,
    sessions,
    table_lines,
)
from mecazen_experiments.identify.models import jackknife
from mecazen_experiments.identify.motors import identified_motors
from mecazen_experiments.identify.windows import (
    TURNS,
    drifts,
    ideal_matrix,
    in_reference,
    mounted,
    odometry,
    shifted,
)

HORIZON_S = 10.0
"""Time after which drift is measured."""
ROLLER_SHARE = 0.3
"""Maximum rotation of a wheel in a step at its highest speed, as a share of the roller pitch."""
TURNED_S, TURN_S = 60.0, 0.5
"""Duration of the part of a run whose yaw is compared with the simulation, and length of its
parts."""

Drifts = dict[tuple[str, str], list[Interval]]
"""Median and 95th percentile of the drift in position [m], then in yaw [rad], with intervals over
sessions, by model and kind of path."""


def simulated(robot: Robot, run: Run) -> Array:
    """Return the poses of the wheels' centre (n, 3) from a simulation with a run's wheel speeds."""
    pitch = 2.0 * math.pi / robot.rollers.count
    longest = min(PhysicsConfig().dt_s, ROLLER_SHARE * pitch / robot.wheels.max_speed_rad_s)
    steps = math.ceil(run.period_s / longest - 1e-6)
    physics = PhysicsConfig(dt_s=round(run.period_s / steps, 9))
    simulation = Simulation([(robot, Pose2D())], physics)
    speeds = np.diff(run.wheels, axis=0) / run.period_s
    poses = np.zeros((len(run.times), 3))
    for index, command in enumerate(speeds.tolist(), 1):
        simulation.advance([WheelCommand(command)], steps)
        state = simulation.robots[0].state
        poses[index] = *state.position[:2], state.yaw
    poses[:, 2] = np.unwrap(poses[:, 2])
    return shifted(poses, np.array(robot.wheels.centre_m))


def identified_robot(robot: Robot, result: Identification, run: Run) -> Robot:
    """Return the robot file with the identified radius, lever, number of rollers, and motors.

    Wheelbase and track are scaled by the same factor. Since contacts move along the axles, a robot
    turns by another angle than the ideal kinematics of its file. So the scale is chosen such that
    the simulation of a run turns as far as the identified kinematics.

    Raises:
        ConfigError: Such a robot can't be simulated.
    """
    radius, lever = (result.geometry.by_name[name] for name in ("radius_m", "lever_m"))

    def scaled(scale: float) -> Robot:
        wheels = msgspec.structs.replace(
            robot.wheels,
            radius_m=round(radius, 6),
            wheelbase_m=round(robot.wheels.wheelbase_m * scale, 6),
            track_m=round(robot.wheels.track_m * scale, 6),
        )
        rollers = msgspec.structs.replace(robot.rollers, count=result.rollers)
        try:
            return msgspec.structs.replace(robot, wheels=wheels, rollers=rollers)
        except ValueError as error:
            raise ConfigError(f"the identified robot: {error}") from None

    end = round(TURNED_S / run.period_s)
    short = replace(run, times=run.times[:end], poses=run.poses[:end], wheels=run.wheels[:end])
    size = max(1, round(TURN_S / run.period_s))
    ideal = np.diff((short.wheels @ TURNS)[::size]) * radius / 4.0 / lever
    turned = np.diff(simulated(scaled(lever / robot.lever), short)[::size, 2])
    gain = float(turned @ ideal / (ideal @ ideal))
    changed = scaled(gain * lever / robot.lever)
    if result.motors:
        motors = identified_motors(robot.motors or RealMotors(), result.motors)
        changed = msgspec.structs.replace(changed, motors=motors)
    return changed


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


def validation_lines(
    result: Identification, drifts: Mapping[tuple[str, str], Sequence[Interval]]
) -> Iterator[str]:
    """Yield the report of a validation as Markdown; `drifts` are those of `validate`."""
    yield "# Validation\n"
    yield (
        f"Fitted on {result.sessions} sessions, validated on the others. "
        f"Drift after {HORIZON_S:g} s: median (95 % interval over sessions; of two, half of their "
        "difference on both sides), 95th percentile.\n"
    )
    yield from table_lines(
        ("model", "path", "position [mm]", "yaw [mrad]"),
        ([*names, _cell(*drift[:2]), _cell(*drift[2:])] for names, drift in drifts.items()),
    )


def _cell(median: Interval, p95: Interval) -> str:
    return f"{interval(median, '.1f', 1e3)}, {1e3 * p95.mean:.1f}"
