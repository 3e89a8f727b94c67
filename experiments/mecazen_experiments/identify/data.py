"""Recordings of a robot: wheel angles and a reference pose at the same instants, and their checks.

A recording is of `mecazen record` or rosbag2, a CSV file with named columns, or a folder of
sessions in the format of OptiOdom's data.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mecazen.errors import ConfigError
from mecazen.files import read_bytes
from mecazen.keys import GROUND_TRUTH, JOINT_COMMAND, JOINT_STATES
from mecazen.messages import JointState
from mecazen.robot import WHEEL_JOINTS
from mecazen.text import printable
from mecazen.wire import NS_PER_S
from mecazen_recorder.foreign import open_recording

Array = npt.NDArray[np.float64]

OPTIODOM_FORWARD = np.array([1.0, -1.0, 1.0, -1.0])
"""Signs of OptiOdom's wheels while the robot drives forward."""
TOPICS = {topic.key: topic for topic in (JOINT_STATES, GROUND_TRUTH, JOINT_COMMAND)}

MAX_GAP = 5.0
"""Longest interval between two samples that does not count as a gap [sample periods]."""
MIN_SAMPLES = 50
MAX_PERIOD_S = 0.25
"""Maximum interval between two samples: a window of 0.5 s has two."""


@dataclass(frozen=True)
class Run:
    """One run; arrays have a row for each sample."""

    name: str
    session: str
    """Name of the session; its runs share all conditions that differ from day to day."""
    times: Array
    """Increasing times (n,) [s]."""
    poses: Array
    """x [m], y [m] and continuous yaw [rad] of the reference (n, 3)."""
    wheels: Array
    """Angles of the wheels in the order of `WHEELS`, forward is positive (n, 4) [rad]."""
    group: str = ""
    """Name of the group; its runs share noise and the mounting of the reference's markers."""
    gaps: tuple[int, ...] = ()
    """Indices of the samples before gaps."""

    @property
    def path(self) -> str:
        """Kind of path: the session's name up to the first "_"."""
        return self.session.split("_", maxsplit=1)[0]

    @property
    def period_s(self) -> float:
        """Time between two samples [s]."""
        return float(np.median(np.diff(self.times)))

    def starts(self, size: int, margin: int = 0) -> npt.NDArray[np.int_]:
        """Return the first samples of consecutive windows of `size` steps without a gap."""
        first = np.arange(margin, len(self.times) - size - margin, size)
        gaps = np.asarray(self.gaps, dtype=int)[:, None]
        whole: npt.NDArray[np.bool_] = ~np.any((gaps >= first) & (gaps < first + size), axis=0)
        return first[whole]


@dataclass(frozen=True)
class MotorLog:
    """The signals of a run's motors, at equal intervals."""

    period_s: float
    commands: Array
    """Commanded speeds during each interval (n, 4) [rad/s]."""
    speeds: Array
    """Mean speeds during each interval, from the wheels' positions (n, 4) [rad/s]."""


def checked(run: Run) -> Run:
    """Return a run with continuous yaw and its gaps.

    Raises:
        ConfigError: One line with the run, the sample and the reason.
    """
    count = len(run.times)
    if count < MIN_SAMPLES:
        raise ConfigError(f"{run.name}: has {count} samples; at least {MIN_SAMPLES} are needed")
    columns = {"time": run.times[:, None], "pose": run.poses, "wheels": run.wheels}
    for column, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise ConfigError(
                f"{run.name}: {column} of sample {bad[0] + 1} is not a finite number; "
                f"{len(bad)} of {count} samples are not"
            )
    steps = np.diff(run.times)
    if len(back := np.flatnonzero(steps <= 0.0)):
        first = back[0]
        raise ConfigError(
            f"{run.name}: time must increase, but sample {first + 2} is at "
            f"{run.times[first + 1]:g} s after {run.times[first]:g} s"
        )
    if (period := float(np.median(steps))) > MAX_PERIOD_S:
        raise ConfigError(
            f"{run.name}: has a sample every {period:.3g} s; at most {MAX_PERIOD_S:g} s is "
            "allowed, with time in seconds"
        )
    yaw = run.poses[:, 2]
    if np.any(np.abs(np.abs(np.diff(yaw)) - 360.0) < 36.0):
        raise ConfigError(f"{run.name}: yaw jumps by 360: it must be in radians, not degrees")
    poses = run.poses.copy()
    poses[:, 2] = np.unwrap(yaw)
    gaps = np.flatnonzero(steps > MAX_GAP * period)
    return replace(run, poses=poses, gaps=tuple(gaps.tolist()))


def read(
    sources: Sequence[Path], topics: str = "", joints: Sequence[str] = WHEEL_JOINTS
) -> tuple[list[Run], list[MotorLog]]:
    """Return the runs of recordings or folders of sessions, and their motors' logs.

    Args:
        sources: Files of `open_recording` and folders in the format of OptiOdom's data.
        topics: The topics of recordings, as `open_recording` takes them.
        joints: The wheels' joints, in the order of `WHEELS`.

    Raises:
        ConfigError: One line with the file and the reason.
        RecordingError: A recording can't be read.
    """
    runs: list[Run] = []
    logs: list[MotorLog] = []
    for path in sources:
        if path.is_dir() and not (path / "metadata.yaml").is_file():
            runs += optiodom(path)
        else:
            named = WHEEL_JOINTS if path.suffix == ".csv" else joints
            recorded_runs, recorded_logs = _recorded(path, topics, named)
            runs += recorded_runs
            logs += recorded_logs
    return runs, logs


def optiodom(folder: Path) -> list[Run]:
    """Return the runs of a folder of sessions in the format of OptiOdom's data.

    A session is a folder with `metadata.csv` and `run-NN.csv`, plain or as gzip. A run has the
    columns time [s], x [m], y [m], yaw [rad], and the displacement of the wheels 1 to 4
    [revolutions per sample]. The published reference is stretched to the odometry's duration. So
    rotation that the odometry did not log is corrected by the ratio of both durations in
    `metadata.csv` (`gt_ti`, `gt_tf`, `odo_ti`, `odo_tf`), if they are given.

    Raises:
        ConfigError: One line with the file and the reason.
    """
    sessions = [
        session
        for session in (folder, *sorted(folder.glob("*/")))
        if (session / "metadata.csv").is_file()
    ]
    if not sessions:
        raise ConfigError(f"{folder}: no session: a folder with metadata.csv and run-01.csv[.gz]")
    return [run for session in sessions for run in _session(session)]


def _session(folder: Path) -> list[Run]:
    text = _text(folder / "metadata.csv")
    metadata = {row[0]: row[1:] for row in csv.reader(io.StringIO(text)) if row}
    markers = " ".join(filter(None, metadata.get("imarkers", ())))
    path = folder.name.split("_", maxsplit=1)[0]
    runs = []
    for file in sorted((*folder.glob("run-*.csv"), *folder.glob("run-*.csv.gz"))):
        table = _numbers(_text(file), file, 8)
        number = file.name.removeprefix("run-").split(".")[0]
        stretch = _stretch(metadata, int(number) - 1, folder) if number.isdecimal() else 1.0
        turned = np.cumsum(table[:, 4:] * OPTIODOM_FORWARD, axis=0)
        run = Run(
            name=f"{folder.name}/{file.name}",
            session=folder.name,
            times=table[:, 0],
            poses=table[:, 1:4],
            wheels=2.0 * math.pi * stretch * turned,
            group=f"{path}, markers {markers}" if markers else path,
        )
        runs.append(checked(run))
    if not runs:
        raise ConfigError(f"{folder}: no run-*.csv or run-*.csv.gz")
    return runs


def _stretch(metadata: Mapping[str, Sequence[str]], index: int, folder: Path) -> float:
    """Return the duration of the reference over that of the odometry; 1 if they are not given."""
    try:
        begin, end, first, last = (
            float(metadata[name][index]) for name in ("gt_ti", "gt_tf", "odo_ti", "odo_tf")
        )
        ratio = (end - begin) / (last - first)
    except (KeyError, IndexError):
        return 1.0
    except (ValueError, ZeroDivisionError):
        ratio = math.nan
    if not 0.5 < ratio < 2.0:
        raise ConfigError(
            f"{folder / 'metadata.csv'}: durations of run {index + 1}: the reference's over the "
            f"odometry's is {ratio:.3g}; it must be within 0.5 to 2"
        )
    return ratio


def _text(path: Path) -> str:
    content = read_bytes(path)
    try:
        return (gzip.decompress(content) if path.suffix == ".gz" else content).decode()
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise ConfigError(
            printable(f"{path}: can't be read as CSV, plain or as gzip: {error}")
        ) from None


def _numbers(text: str, path: Path, columns: int) -> Array:
    """Return the cells of a text in CSV (n, columns)."""
    try:
        table = np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2) if text.strip() else None
    except ValueError as error:
        raise ConfigError(printable(f"{path}: {error}")) from None
    if table is None or table.shape[1] != columns:
        raise ConfigError(f"{path}: must have rows with {columns} columns")
    return np.asarray(table)


def _recorded(path: Path, topics: str, joints: Sequence[str]) -> tuple[list[Run], list[MotorLog]]:
    """Return the runs of a recording with one robot, and the logs of the motors.

    The wheels are those of `joint_states`, the reference is `ground_truth/odom`: the simulator's
    truth, or motion capture that is published on that key.
    """
    recording = open_recording(path, topics)
    by_run: dict[int, dict[str, list[tuple[float, Any]]]] = {}
    for sample in recording.samples():
        topic = TOPICS.get(sample.key)
        if topic is not None and sample.stamp is not None:
            with recording.reading(sample):
                message = sample.message(topic.type)
            samples = by_run.setdefault(sample.stamp.run, {key: [] for key in TOPICS})
            samples[sample.key].append((sample.time_ns / NS_PER_S, message))
    if not by_run:
        raise ConfigError(f"{path}: no joint_states{recording.hint(JOINT_STATES.key)}")
    runs, logs = [], []
    for number, samples in by_run.items():
        name = f"{path.name}, run {number}"
        for key in (JOINT_STATES.key, GROUND_TRUTH.key):
            if len(samples[key]) < 2:
                raise ConfigError(f"{name}: no {key}{recording.hint(key)}")
        times, wheels = _wheels(name, JOINT_STATES.key, samples, "position", joints)
        truth_times = np.array([time for time, _ in samples[GROUND_TRUTH.key]])
        poses = np.array([truth.pose.pose.to_planar() for _, truth in samples[GROUND_TRUTH.key]])
        poses[:, 2] = np.unwrap(poses[:, 2])
        runs.append(checked(Run(name, path.stem, times, _at(times, truth_times, poses), wheels)))
        commands = samples[JOINT_COMMAND.key]
        if commands and all(command.velocity for _, command in commands):
            begins, speeds = _wheels(name, JOINT_COMMAND.key, samples, "velocity", joints)
            logs.append(_motor_log(times, wheels, begins, speeds))
    return runs, logs


def _wheels(
    name: str,
    key: str,
    samples: Mapping[str, Sequence[tuple[float, JointState]]],
    field: str,
    joints: Sequence[str],
) -> tuple[Array, Array]:
    """Return the times (n,) of a topic, and a field of the wheels, e.g. `position` (n, 4)."""
    times, rows = [], []
    for time, state in samples[key]:
        values = dict(zip(state.name, getattr(state, field), strict=False))
        try:
            rows.append([values[joint] for joint in joints])
        except KeyError as error:
            listed = f"it has {', '.join(values) or 'none'}; `wheels.joints` of --robot names them"
            problem = f"{key}: no {field} of {error.args[0]}; {listed}"
            raise ConfigError(printable(f"{name}: {problem}")) from None
        times.append(time)
    return np.array(times), np.array(rows)


def _at(times: Array, sampled: Array, values: Array) -> Array:
    """Return the values at other times, interpolated (n, k)."""
    return np.stack([np.interp(times, sampled, column) for column in values.T], axis=1)


def _motor_log(times: Array, wheels: Array, begins: Array, commands: Array) -> MotorLog:
    """Return the log at equal intervals of commands that hold from the times `begins`."""
    period = float(np.median(np.diff(times)))
    count = round((times[-1] - times[0]) / period)
    grid = times[0] + period * np.arange(count + 1)
    held = np.searchsorted(begins, grid[:-1] + 1e-6, side="right")
    speeds = np.diff(_at(grid, times, wheels), axis=0) / period
    return MotorLog(period, np.concatenate([np.zeros((1, 4)), commands])[held], speeds)
