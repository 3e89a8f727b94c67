"""A recorded run as a trajectory, like that of `mecazen simulate`."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from mecazen import keys
from mecazen.config import Scenario
from mecazen.robots import join_key, split_key
from mecazen.wire import NS_PER_S
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError
from msgspec.structs import replace

from mecazen_tools.trajectory import SOURCES, Columns, Row, Trajectory

MAX_GAP_NS = NS_PER_S // 2
"""Longest time without a pose of a person in a recording of others."""
Rows = dict[str, dict[int, Row]]
"""The values of a run by key, which includes the robot's name, and by simulated time [ns]."""


class RecordedTrajectory(Trajectory):
    """The rows from the first to the last true pose of a robot, whichever program drove it."""

    def __init__(self, run: int, scenario: Scenario, columns: Columns) -> None:
        self.run = run
        self.scenario = scenario
        self._columns = columns

    @property
    def ticks(self) -> range:
        poses = [
            tick
            for (_, topic), column in self._columns.items()
            if topic is keys.GROUND_TRUTH
            for tick in column
        ]
        return range(min(poses), max(poses) + 1)

    @property
    def done(self) -> int:
        return len(self.ticks)


def trajectory_of(recording: Recording, number: int | None = None) -> RecordedTrajectory:
    """Return the trajectory of a run, by default of the last one.

    Raises:
        RecordingError: There is no such run, or a robot's true pose was not recorded.
    """
    runs, seeds = _read(recording)
    if not runs:
        cut = ", and its end is missing" if recording.is_cut_off else ""
        raise RecordingError(f"{recording.path}: no run in it{cut}")
    run = list(runs)[-1] if number is None else number
    if run not in runs:
        allowed = ", ".join(map(str, runs))
        raise RecordingError(f"--run {run}: not in {recording.path}, which holds {allowed}")
    scenario = recording.scenario(run, "follower")
    columns: Columns = {}
    for robot in scenario.names:
        truths, persons = (join_key(t.key, robot) for t in (keys.GROUND_TRUTH, keys.TARGET_ODOM))
        if recording.is_foreign and persons in runs[run]:
            runs[run][persons] = _at(runs[run].get(truths, {}), runs[run][persons])
        for topic in SOURCES:
            column = columns[robot, topic] = {}
            for time_ns, row in runs[run].get(join_key(topic.key, robot), {}).items():
                column.setdefault(time_ns // scenario.sim.tick_ns, row)
        if not columns[robot, keys.GROUND_TRUTH]:
            problem = f"nothing on {truths} in run {run}{recording.hint(truths)}"
            raise RecordingError(f"{recording.path}: {problem}")
    seed = seeds.get(run, scenario.seed)
    return RecordedTrajectory(run, replace(scenario, seed=seed), columns)


def _at(times: Iterable[int], rows: dict[int, Row]) -> dict[int, Row]:
    """Return the motion at other times [ns], interpolated except in gaps."""
    if rows.keys() == {*times}:
        return rows
    known = np.array(sorted(rows))
    values = np.array([rows[time] for time in known.tolist()], dtype=float)
    values[:, 2] = np.unwrap(values[:, 2])
    inside = np.array([time for time in times if known[0] <= time <= known[-1]], dtype=int)
    after = np.searchsorted(known, inside)
    inside = inside[(known[after] == inside) | (known[after] - known[after - 1] <= MAX_GAP_NS)]
    columns = [np.interp(inside, known, column).tolist() for column in values.T]
    return dict(zip(inside.tolist(), zip(*columns, strict=True), strict=True))


def _read(recording: Recording) -> tuple[dict[int, Rows], dict[int, int]]:
    """Return the values and the seed of each run.

    A sample without a stamp, such as a command by hand, belongs to the current run.

    Raises:
        RecordingError: The content of a sample does not match its key.
    """
    topics = {topic.key: topic for topic in SOURCES}
    runs: dict[int, Rows] = {}
    seeds: dict[int, int] = {}
    number = None
    for sample in recording.samples():
        if sample.stamp is not None:
            number = sample.stamp.run
            runs.setdefault(number, {})
        if number is None:
            continue
        key = recording.topic_key(number, sample.key)
        robot, name = split_key(key, recording.robots(number))
        if sample.stamp is not None and not robot:
            seeds.setdefault(number, sample.stamp.seed)  # each of several robots has its own
        if (topic := topics.get(name)) is not None:
            _, values, _ = SOURCES[topic]
            with recording.reading(sample):
                row = values(sample.message(topic.type))
            runs[number].setdefault(key, {}).setdefault(sample.time_ns, row)
    return runs, seeds
