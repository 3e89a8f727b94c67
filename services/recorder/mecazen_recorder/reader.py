"""Reads files of `mecazen_recorder.writer`, also truncated ones."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.well_known import MessageEncoding
from mecazen.config import Scenario
from mecazen.description import RobotDescription
from mecazen.errors import ConfigError
from mecazen.explain import one_line
from mecazen.files import open_regular, parse_toml
from mecazen.graph import TABLE
from mecazen.keys import TOPICS
from mecazen.loading import from_tables, robots_in
from mecazen.messages import Message, MessageT
from mecazen.robots import split_key
from mecazen.text import printable
from mecazen.wire import JSON_ENCODING, Stamp, decode, encode
from mecazen_ros import cdr
from zstandard import ZstdError

from mecazen_recorder.writer import LIBRARY, URDF, RecordingError

_DAMAGE = (McapError, struct.error, ZstdError, ValueError, MemoryError, OverflowError, RuntimeError)
"""Errors of the library on missing or corrupt bytes."""

WITH_FILES = ("target", "crowd", "bus")
"""Sections that refer to files, such as a recorded walk."""
_TYPES: dict[str, type[Message]] = {topic.type.ROS_TYPE: topic.type for topic in TOPICS}


def _code(tables: dict[str, Any]) -> dict[str, str]:
    """Return the programs of a scenario that are not installed nodes but files or modules."""
    programs = tables.get("programs")
    named = programs.items() if isinstance(programs, dict) else ()
    return {name: str(program) for name, program in named if ":" in str(program)}


class Sample(NamedTuple):
    """A published sample."""

    key: str
    time_ns: int
    """Simulated time [ns]."""
    stamp: Stamp | None
    """None if the publisher sent none."""
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
        return encode(self.message(kind), "json"), JSON_ENCODING, attachment


class UntrustedError(ConfigError):
    """A recording names programs that would run."""


class Recording:
    """A recording, for reading.

    Args:
        path: Its file.
        trusted: Whether to import programs that its configurations name. They are code.

    Raises:
        RecordingError: It can't be read, or is not a file of `mecazen record`.
    """

    def __init__(self, path: Path, *, trusted: bool = False) -> None:
        self.path = path
        self.trusted = trusted
        self.scenarios: dict[int, str] = {}
        """The recorded configuration of each run in TOML; filled in by `samples`."""
        self._robots: dict[int, tuple[str, ...]] = {}
        self._files: dict[str, bytes] = {}
        self.is_cut_off = False
        """Whether the end is missing; known after `samples` is exhausted."""
        with open_regular(path) as file:
            header = next(self._records(file), None)
        if not isinstance(header, Header):
            raise RecordingError(f"{path}: not an MCAP file")
        if header.library.partition(" ")[0] != LIBRARY:
            raise RecordingError(
                f"{path}: an MCAP file of {header.library!r}, not of `mecazen record`"
            )

    def samples(self, begin_ns: float = 0, end_ns: float = math.inf) -> Iterator[Sample]:
        """Return the samples in recorded order, between two simulated times of each run."""
        schemas: dict[int, type[Message] | None] = {}
        channels: dict[int, tuple[str, Stamp | None, str, type[Message] | None]] = {}
        with open_regular(self.path) as file:
            for record in self._records(file):
                if isinstance(record, Metadata):
                    self._note_run(record)
                elif isinstance(record, Attachment):
                    self._files[record.name] = record.data
                elif isinstance(record, Schema):
                    schemas[record.id] = _TYPES.get(record.name)
                elif isinstance(record, Channel):
                    kind, meta = schemas.get(record.schema_id), record.metadata
                    run = Stamp(0, int(meta["run"]), int(meta["seed"])) if "run" in meta else None
                    encoding = record.message_encoding
                    if encoding != MessageEncoding.CDR:
                        encoding = meta.get("zenoh_encoding", JSON_ENCODING)
                    channels[record.id] = record.topic, run, encoding, kind
                elif isinstance(record, DataEnd):
                    return
                elif (
                    isinstance(record, Record)
                    and begin_ns <= record.log_time <= end_ns
                    and record.channel_id in channels  # missing if its chunk is corrupt
                ):
                    key, run, encoding, kind = channels[record.channel_id]
                    stamp = None if run is None else run._replace(time_ns=record.log_time)
                    yield Sample(key, record.log_time, stamp, record.data, encoding, kind)
        self.is_cut_off = True

    def descriptions(self) -> dict[str, RobotDescription]:
        """Return the recorded description of each robot, by name."""
        next((sample for sample in self.samples() if sample.stamp is not None), None)
        found = {}
        for name, urdf in self._files.items():
            robot, _, file = name.rpartition("/")
            if file == URDF:
                parts = ((*split_key(other, (robot,)), data) for other, data in self._files.items())
                own = {other: data for whose, other, data in parts if whose == robot}
                del own[URDF]
                found[robot] = RobotDescription(urdf.decode(), own)
        return found

    def robots(self, run: int) -> tuple[str, ...]:
        """Return the names of a run's robots, known once `samples` has read them."""
        return self._robots.get(run, ("",))

    def scenario(self, run: int, *sections: str) -> Scenario:
        """Return the configuration of a run, with defaults for some sections unless they are named.

        These are the sections `WITH_FILES`, whose files may no longer exist, and the sections of
        user nodes. If the recording is not trusted, programs that are not installed are left out.

        Raises:
            RecordingError: It is not in the recording.
            ConfigError: It is no longer valid.
        """
        if run not in self.scenarios:
            raise RecordingError(f"{self.path}: without the configuration of run {run}")
        try:
            tables = parse_toml(self.scenarios[run])
        except ValueError as error:
            reason = one_line(f"the configuration of run {run} is damaged: {error}")
            raise RecordingError(f"{self.path}: {reason}") from None
        code = {} if self.trusted else _code(tables)
        programs = tables.get("programs", {})
        if code:
            tables["programs"] = {name: of for name, of in programs.items() if name not in code}
        optional = {*code, *programs.keys() - TABLE.keys(), *WITH_FILES}

        def wanted(tables: dict[str, Any]) -> dict[str, Any]:
            return {
                name: table
                for name, table in tables.items()
                if name not in optional or name in sections
            }

        robots = [wanted(robot) for robot in tables.get("robots", ())]
        return from_tables({**wanted(tables), "robots": robots}, self.path)

    def refuse_code(self) -> None:
        """Check that the recording would run only installed programs.

        Raises:
            UntrustedError: It would run another one; call this after `samples` has read the
                configurations.
        """
        found: dict[str, None] = {}
        for text in () if self.trusted else self.scenarios.values():
            with suppress(ValueError):  # a damaged one is reported when it is needed
                found |= dict.fromkeys(_code(parse_toml(text)).values())
        if found:
            names = printable(", ".join(found))
            raise UntrustedError(f"{self.path}: would run its programs {names}: --trust allows it")

    def _records(self, file: IO[bytes]) -> Iterator[McapRecord]:
        """Return the records up to the end of the data or the first corrupt one."""
        limit = self.path.stat().st_size
        reader = StreamReader(file, emit_chunks=True, record_size_limit=limit)
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    yield from breakup_chunk(record, validate_crc=True)
                elif not isinstance(record, Channel | Record):  # outside of a chunk: corrupt
                    yield record
        except InvalidMagic:
            raise RecordingError(f"{self.path}: not an MCAP file") from None
        except _DAMAGE:
            return

    def _note_run(self, record: Metadata) -> None:
        run = record.metadata
        # metadata has no checksum: ignore invalid values
        if record.name == "run" and "scenario" in run and run.get("run", "").isdecimal():
            self.scenarios[int(run["run"])] = run["scenario"]
            self._robots[int(run["run"])] = robots_in(run["scenario"])
