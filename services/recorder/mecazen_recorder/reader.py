"""Reads files of `mecazen_recorder.writer`, also truncated ones."""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Channel, DataEnd, Header, McapRecord, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding
from mecazen.config import Scenario
from mecazen.errors import ConfigError, UntrustedError
from mecazen.files import open_regular, parse_toml
from mecazen.graph import NODES
from mecazen.keys import TOPICS
from mecazen.loading import from_tables, renamed_in, robots_in
from mecazen.messages import Message, MessageT
from mecazen.text import printable, shortened
from mecazen.urdf import RobotDescription, build_meshes, build_urdf
from mecazen.wire import JSON_ENCODING, NS_PER_S, RefusedError, Stamp, decode, encode
from mecazen_ros import cdr
from zstandard import ZstdError

from mecazen_recorder.writer import LIBRARY, RecordingError

_DAMAGE = (McapError, struct.error, ZstdError, ValueError, MemoryError, OverflowError, RuntimeError)
"""Errors of the library on missing or corrupt bytes."""
MAX_BYTES = 64 << 20
"""Maximum size of a record [bytes]."""
WITH_FILES = ("target", "crowd", "bus")
"""Sections that refer to files, such as a recorded walk."""
_TYPES: dict[str, type[Message]] = {topic.type.ROS_TYPE: topic.type for topic in TOPICS}


class Sample(NamedTuple):
    """A published sample."""

    key: str
    time_ns: int
    """Simulated time [ns]."""
    stamp: Stamp | None
    """None if the publisher sent no stamp."""
    payload: bytes
    encoding: str
    """A Zenoh encoding, or `cdr`."""
    kind: type[Message] | None
    """The type of the message; None for a key that is not in the table."""

    def message(self, kind: type[MessageT]) -> MessageT:
        """Return the message.

        Raises:
            RefusedError: The payload is not of this type.
        """
        if self.encoding == MessageEncoding.CDR:
            return cdr.decode(self.payload, kind)
        return decode(self.payload, kind, self.encoding)

    def as_published(self, known: type[Message] | None = None) -> tuple[bytes, str, bytes | None]:
        """Return payload, Zenoh encoding and attachment for a bus; messages are in JSON.

        Raises:
            RefusedError: The payload is not of the type of its key.
        """
        attachment = None if self.stamp is None else self.stamp.pack()
        kind = self.kind or known
        if kind is None:
            return self.payload, self.encoding, attachment
        return encode(self.message(kind)), JSON_ENCODING, attachment


class Recording:
    """A recording, for reading.

    Args:
        path: The file of the recording.
        trusted: Whether to import programs and to open files that its configurations name. Programs
            are code.
        scenario: The configuration in TOML of runs that are recorded without it.

    Raises:
        RecordingError: The file can't be read.
    """

    is_foreign = False
    """Whether another program recorded it; see `mecazen_recorder.foreign`."""

    def __init__(self, path: Path, *, trusted: bool = False, scenario: str | None = None) -> None:
        self._set_up(path, trusted, scenario)
        with open_regular(path) as file:
            header = next(self._records(file), None)
        if not isinstance(header, Header):
            raise RecordingError(f"{path}: not an MCAP file")
        if header.library.partition(" ")[0] != LIBRARY:
            self.is_foreign = not self._was_rewritten()

    def _set_up(self, path: Path, trusted: bool, scenario: str | None) -> None:
        self.path = path
        self.trusted = trusted
        self._scenario = scenario
        self.scenarios: dict[int, str] = {}
        """The recorded configuration of each run in TOML; filled in by `samples`."""
        self._robots: dict[int, tuple[str, ...]] = {}
        self._topic_keys: dict[int, dict[str, str]] = {}
        """Keys of topics by their keys on the bus, where these differ, by run."""
        self.is_cut_off = False
        """Whether the end is missing; known after `samples` is exhausted."""

    def samples(self, begin_ns: float = 0, end_ns: float = math.inf) -> Iterator[Sample]:
        """Return the samples in recorded order, between two simulated times of each run.

        Topics with a leading slash are left out: they repeat samples for readers of ROS bags.
        """
        schemas: dict[int, type[Message] | None] = {}
        channels: dict[int, tuple[str, Stamp | None, str, type[Message] | None]] = {}
        with open_regular(self.path) as file:
            for record in self._records(file):
                if isinstance(record, Metadata):
                    self._note_run(record)
                elif isinstance(record, Schema):
                    schemas[record.id] = _TYPES.get(record.name)
                elif isinstance(record, Channel):
                    if not record.topic.startswith("/"):
                        encoding = record.metadata.get("zenoh_encoding", record.message_encoding)
                        kind = schemas.get(record.schema_id)
                        channels[record.id] = record.topic, self._stamp(record), encoding, kind
                elif isinstance(record, DataEnd):
                    return
                elif (
                    isinstance(record, Record)
                    and begin_ns <= record.log_time <= end_ns
                    and record.channel_id in channels
                ):
                    key, run, encoding, kind = channels[record.channel_id]
                    stamp = None if run is None else run._replace(time_ns=record.log_time)
                    yield Sample(key, record.log_time, stamp, record.data, encoding, kind)
        self.is_cut_off = True

    @contextmanager
    def reading(self, sample: Sample) -> Iterator[None]:
        """Report a sample whose content does not match its key as a RecordingError."""
        try:
            yield
        except RefusedError as refusal:
            place = f"{shortened(sample.key)} at {sample.time_ns / NS_PER_S} s"
            raise RecordingError(f"{self.path}: {place}: {refusal}") from None

    def descriptions(self) -> dict[str, RobotDescription]:
        """Return the description of each robot of the first run; none without configuration.

        Raises:
            MecazenError: As `scenario`, if there is a configuration.
        """
        first = next((sample.stamp for sample in self.samples() if sample.stamp is not None), None)
        if first is None or first.run not in self.scenarios:
            return {}
        scenario = self.scenario(first.run)
        parts = {name: scenario.of(name) for name in scenario.names}
        return {
            name: RobotDescription(
                build_urdf(part.robot, part.controller.base_frame_id), build_meshes(part.robot)
            )
            for name, part in parts.items()
        }

    def robots(self, run: int) -> tuple[str, ...]:
        """Return the names of a run's robots, known once `samples` has read them."""
        return self._robots.get(run, ("",))

    def topic_key(self, run: int, key: str) -> str:
        """Return the key of the topic that a run has on a key of the bus."""
        return self._topic_keys.get(run, {}).get(key, key)

    def scenario(self, run: int, *sections: str) -> Scenario:
        """Return the configuration of a run; for `sections` see `read_scenario`.

        Raises:
            RecordingError: The configuration is not in the recording.
            ConfigError: The configuration is no longer valid.
            UntrustedError: The configuration names a file, and the recording is not trusted.
        """
        if run not in self.scenarios:
            remedy = "--scenario NAME says which scenario it was"
            raise RecordingError(f"{self.path}: without the configuration of run {run}; {remedy}")
        try:
            return read_scenario(self.scenarios[run], self.path, sections, trusted=self.trusted)
        except ValueError as error:
            reason = printable(f"the configuration of run {run} is damaged: {error}")
            raise RecordingError(f"{self.path}: {reason}") from None

    def refuse_code(self) -> None:
        """Check that the recording would run only installed programs.

        Raises:
            UntrustedError: It would run another program; call this after `samples` has read the
                configurations.
        """
        programs: dict[str, None] = {}
        for text in () if self.trusted else self.scenarios.values():
            with suppress(ValueError):  # damage is reported when it is needed
                programs |= dict.fromkeys(user_programs(parse_toml(text)).values())
        if programs:
            names = printable(", ".join(programs))
            raise UntrustedError(f"{self.path}: would run its programs {names}")

    def hint(self, key: str) -> str:
        """Return how to take a missing key from another topic; "" in a recording of mecazen."""
        return ""

    def note_scenario(self, run: int, scenario: str) -> None:
        """Note the configuration of a run in TOML."""
        self.scenarios[run] = scenario
        self._robots[run] = robots_in(scenario)
        self._topic_keys[run] = {key: topic for topic, key in renamed_in(scenario).items()}

    def _was_rewritten(self) -> bool:
        """Return whether another program has cut or converted a recording of mecazen.

        It keeps the channels, which it repeats after the data. The configurations may follow the
        data, and are read now.
        """
        has_runs = False
        with open_regular(self.path) as file:
            for record in self._records(file, whole_chunks=True):
                if isinstance(record, Metadata):
                    self._note_run(record)
                has_runs |= isinstance(record, Channel) and "run" in record.metadata
        return has_runs

    def _records(self, file: IO[bytes], *, whole_chunks: bool = False) -> Iterator[McapRecord]:
        """Return the records up to the end of the data or the first corrupt record."""
        reader = StreamReader(
            file, validate_crcs=True, emit_chunks=whole_chunks, record_size_limit=MAX_BYTES
        )
        try:
            yield from reader.records
        except InvalidMagic:
            raise RecordingError(f"{self.path}: not an MCAP file") from None
        except _DAMAGE:
            return

    def _stamp(self, channel: Channel) -> Stamp | None:
        """Return the stamp of a channel's samples, at time 0; None if they have none."""
        if "run" not in channel.metadata:
            return None
        try:
            run = int(channel.metadata["run"])
            if self._scenario is not None and run not in self.scenarios:
                self.note_scenario(run, self._scenario)
            return Stamp(0, run, int(channel.metadata["seed"]))
        except (KeyError, ValueError):
            key = shortened(channel.topic)
            raise RecordingError(f"{self.path}: {key} has no valid run and seed") from None

    def _note_run(self, record: Metadata) -> None:
        run, scenario = record.metadata.get("run", ""), record.metadata.get("scenario")
        if record.name == "run" and run.isdecimal() and scenario is not None:
            self.note_scenario(int(run), scenario)


def read_scenario(
    text: str, path: Path, sections: Collection[str] = (), *, trusted: bool = False
) -> Scenario:
    """Return a recorded scenario, with defaults for some sections unless they are named.

    These are the sections `WITH_FILES`, whose files may no longer exist, and the sections of user
    nodes. Unless the recording at `path` is trusted, programs that are not installed are left out,
    and so are their named sections if they have settings of their own.

    Raises:
        ValueError: The text is not TOML.
        ConfigError: The configuration is no longer valid.
        UntrustedError: The configuration names a file, and is not trusted.
    """
    tables = parse_toml(text)
    programs = tables["programs"] if isinstance(tables.get("programs"), dict) else {}
    left_out = {} if trusted else user_programs(tables)
    if left_out:
        tables["programs"] = _without(programs, left_out)
    optional = {*left_out, *programs.keys() - NODES.keys(), *WITH_FILES} - {*sections}
    kept = _without(tables, optional)
    if isinstance(robots := tables.get("robots"), list):
        kept["robots"] = [_without(robot, optional) for robot in robots]
    try:
        return from_tables(kept, path, opens_files=trusted)
    except ConfigError:
        if left_out.keys().isdisjoint(sections):
            raise
        return read_scenario(text, path, {*sections} - left_out.keys(), trusted=trusted)


def user_programs(tables: dict[str, Any]) -> dict[str, str]:
    """Return the programs of a scenario that are files or modules, not installed nodes."""
    programs = tables.get("programs")
    named = programs.items() if isinstance(programs, dict) else ()
    return {name: str(program) for name, program in named if ":" in str(program)}


def _without(tables: Any, names: Collection[str]) -> Any:
    """Return tables without some of them; another value is returned unchanged."""
    if not isinstance(tables, dict):
        return tables
    return {name: table for name, table in tables.items() if name not in names}
