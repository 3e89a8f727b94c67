"""Recordings of other programs, as the samples that `mecazen_recorder.reader` returns.

Rosbag2 (MCAP, SQLite) and CSV. Names of topics are mapped to keys, poses of any type become
Odometry, and times begin at 0 unless they are simulated times.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from mcap.well_known import MessageEncoding
from mecazen import keys
from mecazen import messages as m
from mecazen.errors import ConfigError, RefusedError
from mecazen.explain import suggestion
from mecazen.files import read_text
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario, scenario_path, to_toml
from mecazen.messages import Message
from mecazen.portable import Floats
from mecazen.robot import WHEEL_JOINTS, WHEELS
from mecazen.robots import join_key
from mecazen.text import printable
from mecazen.wire import NS_PER_S, Stamp
from mecazen_ros import bags, cdr
from mecazen_ros.topics import TwistStamped
from msgspec.structs import replace

from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.writer import RecordingError

RUN = 1
SIMULATED_NS = 10**6 * NS_PER_S
"""Times below this are from the start of a run, later ones of a clock such as that of Unix."""
SYNCHRONOUS_NS = NS_PER_S
"""Most that synchronous clocks differ, with the delay of a message."""
LENGTHS, ANGLES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}, {"rad": 1.0, "deg": math.pi / 180.0}
SPEEDS, RATES = ({f"{u}_s": f for u, f in units.items()} for units in (LENGTHS, ANGLES))
TURNS = {**ANGLES, "rev": math.tau}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units at the ends of a CSV file's columns, in those of the messages."""
LONGEST_STEP_S = 0.3
"""Between the rows of a CSV file without a unit of time."""
POSE = {"x": LENGTHS, "y": LENGTHS, "yaw": ANGLES}
COLUMNS: dict[str, tuple[tuple[str, ...], dict[str, dict[str, float]]]] = {
    keys.GROUND_TRUTH.key: (("robot_", ""), POSE),
    keys.TARGET_ODOM.key: (("target_",), POSE),
    keys.ODOM.key: (("odom_",), POSE),
    keys.JOINT_STATES.key: (("",), dict.fromkeys(WHEELS, TURNS)),
    keys.CMD_VEL.key: (("cmd_",), {"vx": SPEEDS, "vy": SPEEDS, "yaw_rate": RATES}),
}
"""Prefixes and columns of each key in a CSV file, as in that of `mecazen simulate`."""
Source = tuple[str, str]
"""The topic (the prefix of columns) of a key, and the child frame of transforms."""


class Entry(NamedTuple):
    """A message before its times are known."""

    key: str
    topic: str
    logged_ns: int
    type: str
    message: Message | None
    """None, and no content, for a key that is not in the table."""

    @property
    def stamp_ns(self) -> int:
        """The time in the message; 0 if it has none."""
        header = getattr(self.message, "header", None)
        return header.stamp.ns if header is not None else 0


def open_recording(
    path: Path, topics: str = "", scenario: str | None = None, *, trusted: bool = False
) -> Recording:
    """Open a recording of mecazen, of rosbag2 or in CSV.

    Args:
        path: An MCAP, db3 or CSV file, or a folder of rosbag2.
        topics: Names of topics by key, `joint_states=/robot/joint_states,odom=/robot/odom`.
        scenario: The scenario of runs without a configuration, by name or path.
        trusted: As in `Recording`.

    Raises:
        MecazenError: It can't be read, or an argument is wrong.
    """
    sources = _parse_topics(topics)
    text = None if scenario is None else to_toml(load_scenario(scenario_path(scenario)))
    if path.suffix not in (".db3", ".csv") and not path.is_dir():
        recording = Recording(path, trusted=trusted, scenario=text)
        if not recording.is_foreign:
            if sources:
                raise ConfigError(f"--topics: {path} is of mecazen and has the names of keys")
            return recording
    return ForeignRecording(path, sources, text, trusted=trusted)


def _parse_topics(text: str) -> dict[str, Source]:
    """Return the sources by key of a text `KEY=TOPIC,KEY=TOPIC:FRAME`."""
    sources = {}
    for part in filter(None, map(str.strip, text.split(","))):
        key, _, topic = part.partition("=")
        name, _, frame = topic.strip("/").partition(":")
        if not name:
            raise ConfigError(printable(f"--topics {part}: must be KEY=TOPIC, as odom=/robot/odom"))
        if keys.topic_of(key) is None:
            hint = suggestion(key, [known.key for known in keys.TOPICS])
            raise ConfigError(printable(f"--topics {part}: no such key; {hint}see mecazen topics"))
        sources[key] = name, frame
    return sources


class ForeignRecording(Recording):
    """A recording of another program, with one run; for the arguments see `open_recording`."""

    is_foreign = True

    def __init__(
        self, path: Path, sources: Mapping[str, Source], scenario: str | None, *, trusted: bool
    ) -> None:
        self._set_up(path, trusted, scenario)
        self._sources, self._seed = sources, 0
        if scenario is not None:
            self.note_scenario(RUN, scenario)
            self._seed = self.scenario(RUN).seed
        topics = {join_key(t.key, robot): t for robot in self.robots(RUN) for t in keys.TOPICS}
        topics |= {key: topic for key in sources if (topic := keys.topic_of(key))}
        self._types = {key: topic.type for key, topic in topics.items()}
        self._listed: dict[str, str] = {}
        """Types of the topics by name, known once the samples are read."""

    def samples(self, begin_ns: float = 0, end_ns: float = math.inf) -> Iterator[Sample]:
        return (sample for sample in self._samples if begin_ns <= sample.time_ns <= end_ns)

    def hint(self, key: str) -> str:
        if self.path.suffix == ".csv":
            prefixes, quantities = COLUMNS.get(key, ((), {}))
            columns = (f"{prefixes[0]}{q}_{next(iter(units))}" for q, units in quantities.items())
            return printable(f"; needs columns {', '.join(columns)}") if quantities else ""
        fitting = [f"/{name}" for name, kind in self._listed.items() if self._fits(key, kind)]
        if not fitting:
            return "; no topic has its type"
        return printable(f"; --topics {key}=TOPIC takes it from {' or '.join(fitting)}")

    @cached_property
    def _samples(self) -> list[Sample]:
        entries = self._from_csv() if self.path.suffix == ".csv" else self._from_bag()
        missing = self._sources.keys() - {entry.key for entry in entries}
        for key in sorted(missing):
            source = ":".join(filter(None, self._sources[key]))
            listed = ", ".join(self._listed)
            raise RecordingError(printable(f"{self.path}: {key}: no {source}; it has {listed}"))
        times = _times(entries)
        origin = min(times, default=0)
        origin = origin if origin >= SIMULATED_NS else 0
        ordered = sorted(zip(times, entries, strict=True), key=lambda pair: pair[0])
        timed = _with_twists([(time_ns - origin, entry) for time_ns, entry in ordered])
        return [self._sample(time_ns, entry, restamped=origin > 0) for time_ns, entry in timed]

    def _sample(self, time_ns: int, entry: Entry, *, restamped: bool) -> Sample:
        stamp, message = Stamp(time_ns, RUN, self._seed), entry.message
        if message is None:
            return Sample(entry.key, time_ns, stamp, b"", entry.type, None)
        header = getattr(message, "header", None)
        if header is not None and (restamped or not header.stamp.ns):
            header = replace(header, stamp=m.Time.from_ns(time_ns))
            message = replace(message, header=header)
        payload = cdr.encode(message)
        return Sample(entry.key, time_ns, stamp, payload, MessageEncoding.CDR, type(message))

    def _from_bag(self) -> list[Entry]:
        entries = []
        for topic, kind, time_ns, payload in bags.read_bag(self.path):
            name = topic.strip("/")
            self._listed[name] = kind
            targets = [key for key, (source, _) in self._sources.items() if source == name]
            is_known = name not in self._sources and topic not in bags.TREES
            if not targets and is_known and self._fits(name, kind):
                targets = [name]
            for key in targets:
                try:
                    message = self._message(key, kind, payload)
                except RefusedError as refusal:
                    raise RecordingError(printable(f"{self.path}: {topic}: {refusal}")) from None
                if message is not None:
                    entries.append(Entry(key, name, time_ns, kind, message))
            if not targets:
                entries.append(Entry(name, name, time_ns, kind, None))
        return entries

    def _fits(self, key: str, kind: str) -> bool:
        """Return whether a key takes messages of a ROS type."""
        taken = self._types.get(key)
        is_stamped = taken is m.Twist and kind == TwistStamped.ROS_TYPE
        is_pose = taken is m.Odometry and kind in bags.POSE_TYPES
        return is_pose or is_stamped or (taken is not None and kind == taken.ROS_TYPE)

    def _message(self, key: str, kind: str, payload: bytes) -> Message | None:
        taken = self._types[key]
        if not self._fits(key, kind):
            raise RefusedError(f"is a {kind}; {key} takes a {taken.ROS_TYPE}")
        if taken is m.Odometry:
            return bags.odometry(payload, kind, self._sources.get(key, ("", ""))[1])
        return cdr.decode(payload, taken)

    def _from_csv(self) -> list[Entry]:
        columns = _columns(self.path)
        self._listed = dict.fromkeys(columns, "")
        times = _csv_times(self.path, columns)
        entries = []
        for key, (known, quantities) in COLUMNS.items():
            prefixes = (self._sources[key][0],) if key in self._sources else known
            tables = (_quantities(self.path, columns, prefix, quantities) for prefix in prefixes)
            rows = next((table for table in tables if table is not None), np.empty((0, 0)))
            for time_ns, row in zip(times, rows.tolist(), strict=False):
                if all(map(math.isfinite, row)):
                    entries.append(Entry(key, key, time_ns, "", _csv_message(key, row)))
        if not entries:
            listed, hint = ", ".join(columns), self.hint(keys.GROUND_TRUTH.key)
            raise RecordingError(printable(f"{self.path}: nothing known in {listed}{hint}"))
        return entries


def _columns(path: Path) -> dict[str, Floats]:
    """Return the columns of a CSV file by their names; cells without a number are NaN."""
    lines = read_text(path).splitlines()
    if len(lines) < 2:
        raise RecordingError(f"{path}: must have a header and rows")
    delimiter = max(",;\t", key=lines[0].count)
    try:
        table = np.genfromtxt(lines, delimiter=delimiter, names=True, deletechars="", ndmin=1)
    except ValueError as error:
        reason = str(error).splitlines()[1:2] or [str(error)]
        raise RecordingError(f"{path}: {reason[0].strip()}") from None
    return {name: table[name] for name in table.dtype.names or ()}


def _csv_times(path: Path, columns: Mapping[str, Floats]) -> list[int]:
    """Return the times of the rows [ns]; the step between rows shows a missing unit."""
    for name, values in columns.items():
        begin, _, unit = name.lower().partition("_")
        if begin in ("t", "time", "timestamp", "stamp") and unit in ("", *TIMES):
            steps = np.diff(values)
            if len(late := np.flatnonzero(~(steps > 0.0))):
                raise RecordingError(f"{path}: {name} must increase, but not in row {late[0] + 3}")
            step = median(steps.tolist() or [0.0])
            fits = (each for each, factor in TIMES.items() if step * factor <= LONGEST_STEP_S)
            factor = TIMES[unit or next(fits, "ns")] * NS_PER_S
            return [round(value * factor) for value in values.tolist()]
    listed = ", ".join(columns)
    raise RecordingError(printable(f"{path}: no column time_s (ms, us, ns); it has {listed}"))


def _quantities(
    path: Path, columns: Mapping[str, Floats], prefix: str, units: Mapping[str, Mapping[str, float]]
) -> Floats | None:
    """Return quantities in the units of messages (n, k); None if a column is missing."""
    table = []
    for quantity, factors in units.items():
        name = prefix + quantity
        named = {f"{name}_{unit}": factor for unit, factor in factors.items()}
        if name in columns:
            allowed = " or ".join(named)
            raise RecordingError(printable(f"{path}: column {name} has no unit: name it {allowed}"))
        table += [columns[column] * named[column] for column in named if column in columns][:1]
    return np.stack(table, axis=1) if len(table) == len(units) else None


def _csv_message(key: str, row: Sequence[float]) -> Message:
    if key == keys.JOINT_STATES.key:
        return m.JointState(name=WHEEL_JOINTS, position=tuple(row))
    if key == keys.CMD_VEL.key:
        return m.Twist.planar(Twist2D(*row))
    return m.planar_odometry(m.Time(), "", "", Pose2D(*row), Twist2D())


def _times(entries: Sequence[Entry]) -> list[int]:
    """Return the times of messages on one clock [ns].

    Records in simulated time have exact times. Otherwise stamps in messages are the times if all
    are of one clock; those of another clock than the recorder's are shifted to it.
    """
    ahead: dict[str, list[int]] = {}
    for entry in entries:
        if entry.stamp_ns:
            ahead.setdefault(entry.topic, []).append(entry.stamp_ns - entry.logged_ns)
    if not ahead or entries[0].logged_ns < SIMULATED_NS:
        return [entry.logged_ns for entry in entries]
    clocks = {topic: int(median(differences)) for topic, differences in ahead.items()}
    if max(clocks.values()) - min(clocks.values()) <= SYNCHRONOUS_NS:
        common = int(median(clocks.values()))
        return [entry.stamp_ns or entry.logged_ns + common for entry in entries]
    # the shortest delay of a message is about zero
    shifts = {
        topic: 0 if abs(clock) <= SYNCHRONOUS_NS else -max(ahead[topic])
        for topic, clock in clocks.items()
    }
    return [
        entry.stamp_ns + shifts[entry.topic] if entry.stamp_ns else entry.logged_ns
        for entry in entries
    ]


def _with_twists(timed: Sequence[tuple[int, Entry]]) -> list[tuple[int, Entry]]:
    """Return messages in which poses without a velocity have that of their differences."""
    result = list(timed)
    poses: dict[str, dict[int, tuple[int, m.Odometry]]] = {}
    for index, (time_ns, entry) in enumerate(timed):
        if isinstance(entry.message, m.Odometry) and entry.type != m.Odometry.ROS_TYPE:
            poses.setdefault(entry.key, {}).setdefault(time_ns, (index, entry.message))
    for rows in poses.values():
        if len(rows) < 2:
            continue
        places = np.array([message.pose.pose.to_planar() for _, message in rows.values()])
        places[:, 2] = np.unwrap(places[:, 2])
        seconds = (np.array([*rows]) - next(iter(rows))) / NS_PER_S
        rates = np.gradient(places, seconds, axis=0).tolist()
        for (index, message), yaw, (x, y, rate) in zip(
            rows.values(), places[:, 2].tolist(), rates, strict=True
        ):
            cos, sin = math.cos(yaw), math.sin(yaw)
            twist = m.Twist.planar(Twist2D(cos * x + sin * y, cos * y - sin * x, rate))
            moving = replace(message, twist=m.TwistWithCovariance(twist))
            result[index] = timed[index][0], timed[index][1]._replace(message=moving)
    return result
