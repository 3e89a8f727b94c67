"""Writes samples into an MCAP file, in the format of docs/recording.md."""

from __future__ import annotations

import os
import time
from importlib.metadata import version
from pathlib import Path
from typing import IO, NoReturn, cast

import msgspec
from mcap.opcode import Opcode
from mcap.well_known import MessageEncoding
from mcap.writer import Writer
from mecazen.config.services import Encoding
from mecazen.errors import MecazenError
from mecazen.messages import DiagnosticArray, Message
from mecazen.robots import join_key
from mecazen.urdf import RobotDescription
from mecazen.wire import JSON_ENCODING, RefusedError, Stamp, encode
from mecazen_ros import cdr
from mecazen_ros.types import definition

LIBRARY = "mecazen"
CHUNK = bytes([Opcode.CHUNK])
"""The first byte of a chunk."""
URDF = "robot.urdf"
SYNC_S = 0.5
"""Longest wall time for which a sample is only in memory."""

MAX_CHANNELS = 2**16 - 1
MAX_OTHER_CHANNELS = 2**13
"""Maximum number of channels for diagnostics and unknown keys, which any client can invent."""


class RecordingError(MecazenError):
    """A recording can't be written or read; the message names its file."""


class Sink:
    """Buffers records in memory; `sync` writes them to the disk.

    Raises:
        RecordingError: The file exists, or can't be created.
    """

    def __init__(self, path: Path) -> None:
        self.holds_chunk = False
        """Whether a chunk of messages is on the disk."""
        self._path = path
        self._waiting: list[bytes] = []
        self._size = self._synced = 0
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except FileExistsError:
            raise RecordingError(f"{path}: exists already, and is not overwritten") from None
        except OSError as error:
            raise RecordingError(f"{path}: can't be written: {error.strerror}") from None

    def write(self, record: bytes) -> None:
        """Buffer whole records of the file."""
        self._waiting.append(record)
        self._size += len(record)

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self._size

    def flush(self) -> None:
        """Do nothing; `sync` writes."""

    def sync(self) -> None:
        """Write everything to the disk.

        Raises:
            RecordingError: Writing failed, most likely on a full disk; the file then ends with the
                last record that had room.
        """
        kept, holds_chunk = self._synced, self.holds_chunk
        try:
            for record in self._waiting:
                left = memoryview(record)
                while left:
                    left = left[os.write(self._file, left) :]
                kept += len(record)
                holds_chunk |= record.startswith(CHUNK)
        except OSError as error:
            self.holds_chunk = holds_chunk
            self._end_at(kept, error)
        try:
            os.fsync(self._file)
        except OSError as error:
            self._end_at(self._synced, error)
        self._synced, self.holds_chunk = kept, holds_chunk
        self._waiting.clear()

    def _end_at(self, size: int, error: OSError) -> NoReturn:
        os.ftruncate(self._file, size)
        raise RecordingError(f"{self._path}: can't be written on: {error.strerror}") from None

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


def schema_of(kind: type[Message], encoding: Encoding) -> tuple[str, str, bytes]:
    """Return name, encoding and data of a message's schema: ROS's definition, or a JSON schema."""
    if encoding == "cdr":
        return (kind.ROS_TYPE, "ros2msg", definition(kind).encode())
    _, definitions = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
    # readers expect the message at the root, not a reference to it
    text = msgspec.json.encode({**definitions[kind.__name__], "$defs": definitions})
    return (kind.ROS_TYPE, "jsonschema", text)


class RecordingWriter:
    """Writes an MCAP file, which must not exist, with messages in an encoding.

    On a full disk the file ends after the last whole chunk. If there is none, no file is left.

    Raises:
        RecordingError: The file can't be created.
    """

    def __init__(self, path: Path, encoding: Encoding) -> None:
        self.count = 0
        self._path = path
        self._encoding = encoding
        self._channels: dict[tuple[str, Stamp | None, type[Message] | str], int] = {}
        self._other_channels = 0
        self._schemas: dict[type[Message], int] = {}
        self._sink: Sink | None = Sink(path)
        self._mcap = Writer(cast(IO[bytes], self._sink))
        self._mcap.start("ros2" if encoding == "cdr" else "", f"{LIBRARY} {version('mecazen')}")
        self._sync()

    def write(self, key: str, message: Message, stamp: Stamp | None, time_ns: int) -> None:
        """Write a message at the simulated time `time_ns`.

        Raises:
            RefusedError: There are too many keys and runs.
            RecordingError: The disk is full.
        """
        payload = cdr.encode(message) if self._encoding == "cdr" else encode(message)
        self._add(self._channel(key, stamp, type(message)), payload, time_ns)

    def write_bytes(
        self, key: str, payload: bytes, encoding: str, stamp: Stamp | None, time_ns: int
    ) -> None:
        """Write a payload of unknown type unchanged, with its Zenoh encoding; raises as `write`."""
        self._add(self._channel(key, stamp, encoding), payload, time_ns)

    def write_run(self, stamp: Stamp, scenario: str | None) -> None:
        """Write the record of a new run, with its configuration in TOML if known."""
        run = {"run": str(stamp.run), "seed": str(stamp.seed)}
        self._mcap.add_metadata("run", run if scenario is None else {**run, "scenario": scenario})

    def write_description(self, description: RobotDescription, robot: str = "") -> None:
        """Attach the description of a robot: its meshes, then its URDF."""
        for name, data in [*description.meshes.items(), (URDF, description.urdf.encode())]:
            kind = "application/xml" if name == URDF else "application/octet-stream"
            self._mcap.add_attachment(0, 0, join_key(name, robot), kind, data)

    def sync_if_due(self) -> None:
        """Sync to the disk if `SYNC_S` has passed since the last time."""
        if time.monotonic() - self._synced_s >= SYNC_S:
            self._sync()

    def close(self) -> None:
        """Write the index and close the file; a second call has no effect.

        Raises:
            RecordingError: The disk is full.
        """
        if self._sink is None:
            return
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._sync()
        self._sink.close()
        self._sink = None

    def _add(self, channel: int, data: bytes, time_ns: int) -> None:
        self._mcap.add_message(channel, log_time=time_ns, data=data, publish_time=time_ns)
        self.count += 1
        self.sync_if_due()

    def _sync(self) -> None:
        if self._sink is None:
            return
        self._mcap.flush()  # type: ignore[no-untyped-call]
        try:
            self._sink.sync()
        except RecordingError as error:
            sink, self._sink = self._sink, None
            sink.close()
            if sink.holds_chunk:
                raise RecordingError(f"{error}; what was recorded before can be read") from None
            self._path.unlink(missing_ok=True)
            raise
        self._synced_s = time.monotonic()

    def _channel(self, key: str, stamp: Stamp | None, kind: type[Message] | str) -> int:
        run = None if stamp is None else stamp._replace(time_ns=0)
        known = self._channels.get((key, run, kind))
        if known is not None:
            return known
        other = isinstance(kind, str) or kind is DiagnosticArray
        if len(self._channels) >= MAX_CHANNELS or (
            other and self._other_channels >= MAX_OTHER_CHANNELS
        ):
            most = MAX_OTHER_CHANNELS if other else MAX_CHANNELS
            raise RefusedError(f"a file holds at most {most} keys times runs")
        self._other_channels += other
        metadata = {} if run is None else {"run": str(run.run), "seed": str(run.seed)}
        if isinstance(kind, str):
            encoding: str = MessageEncoding.JSON if kind == JSON_ENCODING else ""
            metadata["zenoh_encoding"] = kind
            schema = 0
        else:
            if kind not in self._schemas:
                schema = self._mcap.register_schema(*schema_of(kind, self._encoding))
                self._schemas[kind] = schema
            encoding, schema = self._encoding, self._schemas[kind]
        channel = self._mcap.register_channel(key, encoding, schema, metadata)
        self._channels[key, run, kind] = channel
        return channel
