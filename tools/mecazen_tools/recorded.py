"""The contents of a recording, and a recorded run as a trajectory of `mecazen simulate`."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from itertools import pairwise

import msgspec
import numpy as np
from mecazen import keys
from mecazen.config import Scenario
from mecazen.messages import FollowerState, Parameter, Parameters
from mecazen.robots import join_key, split_key
from mecazen.wire import NS_PER_S
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError
from msgspec.structs import replace

from mecazen_tools.trajectory import SOURCES, Columns, Row, Trajectory, lost_shares, sentence

MAX_GAP_NS = NS_PER_S // 2
"""Longest time without a pose of a person in a recording of others."""
GAP = 1.5
"""Number of medians above which an interval is a gap."""
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


class KeyInfo(msgspec.Struct, frozen=True):
    """The samples on one key."""

    key: str
    type: str
    """The message's ROS type, or the Zenoh encoding for a key that is not in the table."""
    count: int
    rate_hz: float | None
    """Inverse of the median interval of simulated time; None with fewer than two samples."""
    gaps: int
    """Number of intervals of more than 1.5 medians."""
    longest_gap_s: float | None


class RunInfo(msgspec.Struct, frozen=True):
    """One run in a recording. Samples without a stamp belong to no run."""

    run: int
    seed: int | None
    """None if only samples of one of several robots are recorded: each has its own seed."""
    robots: tuple[str, ...]
    """The names of several robots."""
    begin_s: float
    end_s: float
    has_scenario: bool
    """Whether the file holds the run's configuration."""
    changes: tuple[str, ...]
    """Changes of parameters with time and value, after the values set before the run."""
    lost: tuple[str, ...]
    """By robot how long the person was lost, and why."""


class Info(msgspec.Struct, frozen=True):
    """The output of `mecazen info --json`."""

    file: str
    is_cut_off: bool
    """Whether the end of the file is missing, as after a crash."""
    count: int
    duration_s: float
    """Simulated time of all runs together [s]."""
    runs: tuple[RunInfo, ...]
    keys: tuple[KeyInfo, ...]


def inspect(recording: Recording) -> Info:
    """Return the contents of a recording."""
    times: dict[str, dict[int | None, list[int]]] = {}
    types: dict[str, str] = {}
    spans: dict[int, tuple[int, int]] = {}
    seeds: dict[int, int] = {}
    known: dict[int, tuple[Parameter, ...]] = {}
    changes: dict[int, list[str]] = {}
    states: dict[int, dict[str, list[tuple[str, str]]]] = {}
    for sample in recording.samples():
        stamp = sample.stamp
        run = None if stamp is None else stamp.run
        times.setdefault(sample.key, {}).setdefault(run, []).append(sample.time_ns)
        types.setdefault(sample.key, sample.kind.ROS_TYPE if sample.kind else sample.encoding)
        if stamp is not None:
            first, last = spans.get(stamp.run, (sample.time_ns, sample.time_ns))
            spans[stamp.run] = min(first, sample.time_ns), max(last, sample.time_ns)
            robot, key = split_key(sample.key, recording.robots(stamp.run))
            if not robot:
                seeds.setdefault(stamp.run, stamp.seed)
            if key == keys.FOLLOWER_STATE.key:
                with recording.reading(sample):
                    state = sample.message(FollowerState)
                row = state.tracking, state.reason
                states.setdefault(stamp.run, {}).setdefault(robot, []).append(row)
            if sample.key == keys.PARAMETERS.key:
                with recording.reading(sample):
                    message = sample.message(Parameters)
                before, known[stamp.run] = known.get(stamp.run, ()), message.parameters
                if new := [change for change in message.parameters if change not in before]:
                    settings = ", ".join(f"{change.name}={change.value}" for change in new)
                    line = f"t = {message.header.stamp.ns / NS_PER_S:g} s: {settings}"
                    changes.setdefault(stamp.run, []).append(line)
    runs = []
    for run, (first, last) in spans.items():
        names = tuple(filter(None, recording.robots(run)))
        span_s = first / NS_PER_S, last / NS_PER_S
        is_known, changed = run in recording.scenarios, tuple(changes.get(run, ()))
        lost = tuple(
            f"{robot or 'robot'}: {text}"
            for robot, rows in states.get(run, {}).items()
            if (text := sentence(lost_shares(rows)))
        )
        runs.append(RunInfo(run, seeds.get(run), names, *span_s, is_known, changed, lost))
    infos = tuple(_key_info(key, types[key], list(times[key].values())) for key in sorted(times))
    count = sum(info.count for info in infos)
    duration_s = sum(run.end_s - run.begin_s for run in runs)
    return Info(str(recording.path), recording.is_cut_off, count, duration_s, tuple(runs), infos)


def _key_info(key: str, kind: str, runs: list[list[int]]) -> KeyInfo:
    count = sum(map(len, runs))
    # samples of the same tick have no interval
    intervals = [b - a for times in runs for a, b in pairwise(times) if b > a]
    if not intervals:
        return KeyInfo(key, kind, count, None, 0, None)
    median = statistics.median(intervals)
    gaps = [interval for interval in intervals if interval > GAP * median]
    longest_s = max(gaps) / NS_PER_S if gaps else None
    return KeyInfo(key, kind, count, NS_PER_S / median, len(gaps), longest_s)
