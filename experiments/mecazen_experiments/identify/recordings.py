"""Reads runs and the logs of their motors from recordings of `mecazen record`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.keys import GROUND_TRUTH, JOINT_COMMAND, JOINT_STATES
from mecazen.messages import JointState
from mecazen.robot import WHEEL_JOINTS
from mecazen.wire import NS_PER_S
from mecazen_recorder.reader import Recording

from mecazen_experiments.identify.motors import MotorLog
from mecazen_experiments.identify.runs import Array, Run, checked

TOPICS = {topic.key: topic for topic in (JOINT_STATES, GROUND_TRUTH, JOINT_COMMAND)}


def recorded(path: Path) -> tuple[list[Run], list[MotorLog]]:
    """Return the runs of a recording with one robot, and the logs of the motors.

    The wheels are those of `joint_states`, the reference is `ground_truth/odom`: the simulator's
    truth, or motion capture that is published on that key.

    Raises:
        ConfigError: The recording has no wheels, or no reference.
        RecordingError: The recording can't be read.
    """
    recording = Recording(path)
    found: dict[int, dict[str, list[tuple[float, Any]]]] = {}
    for sample in recording.samples():
        topic = TOPICS.get(sample.key)
        if topic is not None and sample.stamp is not None:
            with recording.reading(sample):
                message = sample.message(topic.type)
            own = found.setdefault(sample.stamp.run, {key: [] for key in TOPICS})
            own[sample.key].append((sample.time_ns / NS_PER_S, message))
    if not found:
        raise ConfigError(f"{path}: no joint_states")
    runs, logs = [], []
    for number, own in found.items():
        name = f"{path.name}, run {number}"
        for key in (JOINT_STATES.key, GROUND_TRUTH.key):
            if len(own[key]) < 2:
                raise ConfigError(f"{name}: no {key}")
        times, states = _columns(own[JOINT_STATES.key])
        wheels = _wheels(f"{name}: {JOINT_STATES.key}", states, "position")
        at, truth = _columns(own[GROUND_TRUTH.key])
        poses = _interpolated(times, at, [one.pose.pose.to_planar() for one in truth])
        runs.append(checked(Run(name, path.stem, times, poses, wheels)))
        if own[JOINT_COMMAND.key] and all(
            command.velocity for _, command in own[JOINT_COMMAND.key]
        ):
            logs.append(_motors(name, times, wheels, states, own[JOINT_COMMAND.key]))
    return runs, logs


def _columns(samples: Sequence[tuple[float, Any]]) -> tuple[Array, list[Any]]:
    return np.array([time for time, _ in samples]), [message for _, message in samples]


def _wheels(name: str, states: Sequence[JointState], what: str) -> Array:
    """Return positions, velocities or efforts of the wheels (n, 4)."""
    rows = []
    for state in states:
        values = dict(zip(state.name, getattr(state, what), strict=False))
        try:
            rows.append([values[joint] for joint in WHEEL_JOINTS])
        except KeyError as error:
            raise ConfigError(f"{name}: no {what} of {error.args[0]}") from None
    return np.array(rows)


def _interpolated(times: Array, at: Array, poses: Sequence[Pose2D]) -> Array:
    """Return the poses at other times (n, 3)."""
    columns = np.array(poses).T
    columns[2] = np.unwrap(columns[2])
    return np.stack([np.interp(times, at, column) for column in columns], axis=1)


def _motors(
    name: str,
    times: Array,
    wheels: Array,
    states: Sequence[JointState],
    commands: Sequence[tuple[float, JointState]],
) -> MotorLog:
    """Return the log of the motors at equal intervals."""
    period = float(np.median(np.diff(times)))
    count = round((times[-1] - times[0]) / period)
    grid = times[0] + period * np.arange(count + 1)
    on_grid = np.stack([np.interp(grid, times, column) for column in wheels.T], axis=1)
    at, messages = _columns(commands)
    values = np.concatenate(
        [np.zeros((1, 4)), _wheels(f"{name}: {JOINT_COMMAND.key}", messages, "velocity")]
    )
    held = np.searchsorted(at, grid[:-1] + 1e-6, side="right")
    efforts = None
    if all(state.effort for state in states):
        torques = _wheels(f"{name}: {JOINT_STATES.key}", states, "effort")
        efforts = np.stack([np.interp(grid[1:], times, column) for column in torques.T], axis=1)
    return MotorLog(period, values[held], np.diff(on_grid, axis=0) / period, efforts)
