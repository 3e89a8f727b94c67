"""The contents of a recording: keys, counts, rates, runs and gaps."""

from __future__ import annotations

import statistics
from itertools import pairwise

import msgspec
from mecazen.keys import FOLLOWER_STATE, PARAMETERS
from mecazen.messages import FollowerState, Parameter, Parameters
from mecazen.robots import split_key
from mecazen.wire import NS_PER_S
from mecazen_recorder.reader import Recording

from mecazen_tools.trajectory import lost_shares, sentence

GAP = 1.5
"""Number of medians above which an interval is a gap."""


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
            if key == FOLLOWER_STATE.key:
                with recording.reading(sample):
                    state = sample.message(FollowerState)
                row = state.tracking, state.reason
                states.setdefault(stamp.run, {}).setdefault(robot, []).append(row)
            if sample.key == PARAMETERS.key:
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
