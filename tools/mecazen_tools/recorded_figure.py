"""A recorded run as a figure, like that of `mecazen simulate --plot`."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from mecazen import keys
from mecazen.messages import Message, Odometry, Twist
from mecazen.robots import join_key, split_key
from mecazen.wire import NS_PER_S
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError

from mecazen_tools.run_figure import Course, draw

Rows = dict[str, list[tuple[float, ...]]]
"""The drawn data of a run, by key, which includes the robot's name."""

DRAWN = {topic.key: topic for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM, keys.CMD_VEL)}


def figure(recording: Recording, number: int | None) -> Figure:
    """Return the figure of a run, by default of the last one.

    Raises:
        RecordingError: There is no such run, or a key that the figure needs was not recorded.
    """
    runs = _read(recording)
    if not runs:
        cut = ", and its end is missing" if recording.is_cut_off else ""
        raise RecordingError(f"{recording.path}: no run in it{cut}")
    wanted = list(runs)[-1] if number is None else number
    if wanted not in runs:
        allowed = ", ".join(map(str, runs))
        raise RecordingError(f"--run {wanted}: not in {recording.path}, which holds {allowed}")
    scenario = recording.scenario(wanted, "follower")
    seed, rows = runs[wanted]
    courses = []
    for robot in scenario.names:
        truth = join_key(keys.GROUND_TRUTH.key, robot)
        if truth not in rows:
            raise RecordingError(f"{recording.path}: nothing on {truth} in run {wanted}")
        person, command = (
            rows.get(join_key(topic.key, robot), []) for topic in (keys.TARGET_ODOM, keys.CMD_VEL)
        )
        courses.append(
            Course(
                robot,
                np.array(rows[truth]),
                np.array(person).reshape(-1, 7),
                np.array(command).reshape(-1, 4),
            )
        )
    return draw(courses, scenario, f"{recording.path.name}, run {wanted}, seed {seed}")


def _read(recording: Recording) -> dict[int, tuple[int, Rows]]:
    """Return the seed and the drawn data of each run.

    A sample without a stamp, such as a command by hand, belongs to the current run.

    Raises:
        RecordingError: The content of a sample does not match its key.
    """
    runs: dict[int, tuple[int, Rows]] = {}
    number = None
    for sample in recording.samples():
        if sample.stamp is not None:
            number = sample.stamp.run
            runs.setdefault(number, (sample.stamp.seed, {}))
        if number is None:
            continue
        key = recording.topic_key(number, sample.key)
        topic = DRAWN.get(split_key(key, recording.robots(number))[1])
        if topic is not None:
            with recording.reading(sample):
                row = (sample.time_ns / NS_PER_S, *_numbers(sample.message(topic.type)))
            runs[number][1].setdefault(key, []).append(row)
    return runs


def _numbers(message: Message) -> tuple[float, ...]:
    if isinstance(message, Odometry):
        return (*message.pose.pose.to_planar(), *message.twist.twist.to_planar())
    return message.to_planar() if isinstance(message, Twist) else ()
