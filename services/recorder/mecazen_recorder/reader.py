"""Reads files of `mecazen_recorder.writer`, also truncated ones."""

from __future__ import annotations

import math
import os
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.well_known import MessageEncoding
from mecazen.config import Scenario
from mecazen.errors import UntrustedError
from mecazen.files import open_regular, parse_toml
from mecazen.graph import NODES
from mecazen.keys import TOPICS
from mecazen.loading import from_tables, renamed_in, robots_in
from mecazen.messages import Message, MessageT
from mecazen.robots import split_key
from mecazen.text import printable, shortened
from mecazen.urdf import RobotDescription
from mecazen.wire import JSON_ENCODING, MAX_TIME_NS, NS_PER_S, RefusedError, Stamp, decode, encode
from mecazen_ros import cdr
from zstandard import ZstdDecompressor, ZstdError

from mecazen_recorder.writer import LIBRARY, URDF, RecordingError

_DAMAGE = (McapError, struct.error, ZstdError, ValueError, MemoryError, OverflowError, RuntimeError)
"""Errors of the library on missing or corrupt bytes."""

MAX_BYTES = 64 << 20
"""Maximum size of a record [bytes]."""
MAX_SCENARIO_BYTES = 4 << 20
MAX_CHUNK_BYTES = 1 << 24
"""Maximum size of a chunk, expanded [bytes]: chunks of the writer have about 1 MiB."""
MOST_FOLD = 1000
"""Maximum size of all chunks, expanded, as a multiple of the file's size; about 10 in real runs."""
WITH_FILES = ("target", "crowd", "bus")
"""Sections that refer to files, such as a recorded walk."""
_FILE_NAME = re.compile(r"(?:\w[\w.-]{0,99}/){0,9}\w[\w.-]{0,99}", re.ASCII)
_TYPES: dict[str, type[Message]] = {topic.type.ROS_TYPE: topic.type for topic in TOPICS}


def _code(tables: dict[str, Any]) -> dict[str, str]:
    """Return the programs of a scenario that are not installed nodes but files or modules."""
    programs = tables.get("programs")
    named = programs.items() if isinstance(programs, dict) else ()
    return {name: str(program) for name, program in named if ":" in str(program)}


def _expanded(chunk: Chunk) -> Chunk:
    """Return a chunk with its data expanded, within the size in its header and `MAX_CHUNK_BYTES`.

    Raises:
        ValueError: The chunk is too large, its header is wrong, or its compression is unknown.
        ZstdError: The data can't be expanded.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES or chunk.compression not in {"", "zstd"}:
        raise ValueError(f"a chunk of {size} bytes, compression {chunk.compression!r}")
    data = chunk.data
    if chunk.compression:
        expander = ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
        with expander.stream_reader(data, read_across_frames=True) as stream:
            data = stream.read(size + 1)
    if len(data) != size:
        raise ValueError(f"a chunk is not of {size} bytes")
    return replace(chunk, compression="", data=data)


def _numbers(*texts: str | None) -> tuple[int, ...] | None:
    """Parse texts as unsigned 32-bit integers; return None if a text is not such a number."""
    numbers = [int(text) for text in texts if text and re.fullmatch("[0-9]{1,10}", text)]
    good = len(numbers) == len(texts) and all(number < 2**32 for number in numbers)
    return tuple(numbers) if good else None


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

    Raises:
        RecordingError: The file can't be read, or is not a file of `mecazen record`.
    """

    def __init__(self, path: Path, *, trusted: bool = False) -> None:
        self.path = path
        self.trusted = trusted
        self.scenarios: dict[int, str] = {}
        """The recorded configuration of each run in TOML; filled in by `samples`."""
        self._robots: dict[int, tuple[str, ...]] = {}
        self._topic_keys: dict[int, dict[str, str]] = {}
        """Keys of topics by their keys on the bus, where these differ, by run."""
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
                    if _FILE_NAME.fullmatch(record.name):  # other names are not valid keys
                        self._files[record.name] = record.data
                elif isinstance(record, Schema):
                    schemas[record.id] = _TYPES.get(record.name)
                elif isinstance(record, Channel):
                    kind, meta = schemas.get(record.schema_id), record.metadata
                    run = self._stamp(record) if "run" in meta else None
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
                    if record.log_time > MAX_TIME_NS:
                        raise RecordingError(f"{self.path}: {shortened(key)} at an impossible time")
                    stamp = None if run is None else run._replace(time_ns=record.log_time)
                    yield Sample(key, record.log_time, stamp, record.data, encoding, kind)
        self.is_cut_off = True

    @contextmanager
    def reading(self, sample: Sample) -> Iterator[None]:
        """Report a sample whose content does not match its key as a RecordingError."""
        try:
            yield
        except RefusedError as refusal:
            where = f"{shortened(sample.key)} at {sample.time_ns / NS_PER_S} s"
            raise RecordingError(f"{self.path}: {where}: {refusal}") from None

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
                found[robot] = RobotDescription(urdf.decode(errors="replace"), own)
        return found

    def robots(self, run: int) -> tuple[str, ...]:
        """Return the names of a run's robots, known once `samples` has read them."""
        return self._robots.get(run, ("",))

    def topic_key(self, run: int, key: str) -> str:
        """Return the key of the topic that a run has on a key of the bus."""
        return self._topic_keys.get(run, {}).get(key, key)

    def scenario(self, run: int, *sections: str) -> Scenario:
        """Return the configuration of a run, with defaults for some sections unless they are named.

        These are the sections `WITH_FILES`, whose files may no longer exist, and the sections of
        user nodes. If the recording is not trusted, programs that are not installed are left out.

        Raises:
            RecordingError: The configuration is not in the recording.
            ConfigError: The configuration is no longer valid.
            UntrustedError: The configuration names a file, and the recording is not trusted.
        """
        if run not in self.scenarios:
            raise RecordingError(f"{self.path}: without the configuration of run {run}")
        try:
            tables = parse_toml(self.scenarios[run])
        except ValueError as error:
            reason = printable(f"the configuration of run {run} is damaged: {error}")
            raise RecordingError(f"{self.path}: {reason}") from None
        code = {} if self.trusted else _code(tables)
        programs = tables["programs"] if isinstance(tables.get("programs"), dict) else {}
        if code:
            tables["programs"] = {name: of for name, of in programs.items() if name not in code}
        optional = {*code, *programs.keys() - NODES.keys(), *WITH_FILES}

        def wanted(tables: dict[str, Any]) -> dict[str, Any]:
            return {
                name: table
                for name, table in tables.items()
                if name not in optional or name in sections
            }

        kept = wanted(tables)
        if isinstance(robots := tables.get("robots"), list):
            kept["robots"] = [wanted(one) if isinstance(one, dict) else one for one in robots]
        return from_tables(kept, self.path, opens_files=self.trusted)

    def refuse_code(self) -> None:
        """Check that the recording would run only installed programs.

        Raises:
            UntrustedError: It would run another program; call this after `samples` has read the
                configurations.
        """
        found: dict[str, None] = {}
        for text in () if self.trusted else self.scenarios.values():
            with suppress(ValueError):  # damage is reported when it is needed
                found |= dict.fromkeys(_code(parse_toml(text)).values())
        if found:
            names = printable(", ".join(found))
            raise UntrustedError(f"{self.path}: would run its programs {names}")

    def _records(self, file: IO[bytes]) -> Iterator[McapRecord]:
        """Return the records up to the end of the data or the first corrupt record."""
        reader = StreamReader(file, emit_chunks=True, record_size_limit=MAX_BYTES)
        left = MAX_BYTES + MOST_FOLD * os.fstat(file.fileno()).st_size
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    chunk = _expanded(record)
                    left -= len(chunk.data)
                    if left < 0:
                        raise RecordingError(f"{self.path}: expands more than {MOST_FOLD}-fold")
                    yield from breakup_chunk(chunk, validate_crc=True)
                elif not isinstance(record, Channel | Record):  # outside of a chunk: corrupt
                    yield record
        except InvalidMagic:
            raise RecordingError(f"{self.path}: not an MCAP file") from None
        except _DAMAGE:
            return

    def _stamp(self, channel: Channel) -> Stamp:
        """Return the stamp of a channel's samples, at time 0."""
        numbers = _numbers(channel.metadata["run"], channel.metadata.get("seed"))
        if numbers is None:
            key = shortened(channel.topic)
            raise RecordingError(f"{self.path}: {key} has no valid run and seed")
        return Stamp(0, *numbers)

    def _note_run(self, record: Metadata) -> None:
        # metadata has no checksum: ignore invalid values
        if record.name == "run" and (number := _numbers(record.metadata.get("run"))):
            scenario = record.metadata.get("scenario")
            if scenario is not None and len(scenario) <= MAX_SCENARIO_BYTES:
                self.scenarios[number[0]] = scenario
                self._robots[number[0]] = robots_in(scenario)
                renamed = renamed_in(scenario)
                self._topic_keys[number[0]] = {key: topic for topic, key in renamed.items()}
