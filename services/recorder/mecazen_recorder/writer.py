"""Writes samples into an MCAP file, in the format of docs/recording.md."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mecazen.errors import MecazenError
from mecazen.messages import Message
from mecazen.wire import RefusedError, Stamp
from mecazen_ros import cdr
from mecazen_ros.topics import DESCRIBED
from mecazen_ros.types import definition

LIBRARY = "mecazen"
FLUSH_S = 0.5
"""Longest wall time for which a sample is only in memory."""
MAX_CHANNELS = 2**16 - 1
LATCHED = {topic.rpartition("/")[2] for topic in DESCRIBED}
"""Last parts of latched topics, of which each robot may have one."""
LATCHED_QOS = """\
- history: 1
  depth: 100
  reliability: 1
  durability: 1
  deadline: {sec: 0, nsec: 0}
  lifespan: {sec: 0, nsec: 0}
  liveliness: 0
  liveliness_lease_duration: {sec: 0, nsec: 0}
  avoid_ros_namespace_conventions: false
"""
"""Quality of service as rosbag2 writes it: reliable, transient local. Late subscribers of
`ros2 bag play` receive such topics as well."""


class RecordingError(MecazenError):
    """A recording can't be written or read; the message names its file."""


class RecordingWriter:
    """Writes an MCAP file, which must not exist.

    On a full disk, all that was written before can be read.

    Raises:
        RecordingError: The file exists, or can't be created.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._channels: dict[tuple[str, Stamp | None, type[Message] | str], int] = {}
        self._schemas: dict[type[Message], int] = {}
        self._flushed_s = time.monotonic()
        try:
            self._file = path.open("xb")
        except FileExistsError:
            raise RecordingError(f"{path}: exists already, and is not overwritten") from None
        except OSError as error:
            raise RecordingError(f"{path}: can't be written: {error.strerror}") from None
        self._mcap = Writer(self._file)
        with self._reporting_errors():
            self._mcap.start("ros2", f"{LIBRARY} {version('mecazen')}")
            self._file.flush()

    def write(self, key: str, message: Message, stamp: Stamp | None, time_ns: int) -> None:
        """Write a message at the simulated time `time_ns`.

        Raises:
            RefusedError: There are too many keys and runs, or CDR has no such value.
            RecordingError: The disk is full.
        """
        payload = cdr.encode(message)
        self._add(self._channel(key, stamp, type(message)), payload, time_ns)

    def write_bytes(
        self, key: str, payload: bytes, encoding: str, stamp: Stamp | None, time_ns: int
    ) -> None:
        """Write a payload of unknown type unchanged, with its Zenoh encoding; raises as `write`."""
        self._add(self._channel(key, stamp, encoding), payload, time_ns)

    def write_run(self, stamp: Stamp, scenario: str | None) -> None:
        """Write the record of a new run, with its configuration in TOML if known."""
        run = {"run": str(stamp.run), "seed": str(stamp.seed)}
        with self._reporting_errors():
            self._mcap.add_metadata(
                "run", run if scenario is None else run | {"scenario": scenario}
            )

    def flush_if_due(self) -> None:
        """Write the samples in memory to the file if `FLUSH_S` has passed since the last time."""
        if time.monotonic() - self._flushed_s >= FLUSH_S:
            with self._reporting_errors():
                self._mcap.flush()  # type: ignore[no-untyped-call]
                self._file.flush()
            self._flushed_s = time.monotonic()

    def close(self) -> None:
        """Write the index and close the file; a second call has no effect.

        Raises:
            RecordingError: The disk is full.
        """
        if not self._file.closed:
            with self._reporting_errors():
                self._mcap.finish()  # type: ignore[no-untyped-call]
                self._file.close()

    def _add(self, channel: int, payload: bytes, time_ns: int) -> None:
        with self._reporting_errors():
            self._mcap.add_message(channel, log_time=time_ns, data=payload, publish_time=time_ns)
        self.flush_if_due()

    def _channel(self, key: str, stamp: Stamp | None, kind: type[Message] | str) -> int:
        """Return the channel of a key in a run; `kind` is a Zenoh encoding for unknown types."""
        run = None if stamp is None else stamp._replace(time_ns=0)
        known = self._channels.get((key, run, kind))
        if known is not None:
            return known
        if len(self._channels) >= MAX_CHANNELS:
            raise RefusedError(f"a file holds at most {MAX_CHANNELS} keys times runs")
        metadata = {} if run is None else {"run": str(run.run), "seed": str(run.seed)}
        encoding, schema = "", 0
        if isinstance(kind, str):
            metadata["zenoh_encoding"] = kind
        else:
            if kind not in self._schemas:
                self._schemas[kind] = self._mcap.register_schema(
                    kind.ROS_TYPE, SchemaEncoding.ROS2, definition(kind).encode()
                )
            encoding, schema = MessageEncoding.CDR, self._schemas[kind]
        if key.startswith("/") and key.rpartition("/")[2] in LATCHED:
            metadata["offered_qos_profiles"] = LATCHED_QOS
        channel = self._mcap.register_channel(key, encoding, schema, metadata)
        self._channels[key, run, kind] = channel
        return channel

    @contextmanager
    def _reporting_errors(self) -> Iterator[None]:
        """Report an error of the disk in one line; the file then ends where it occurred."""
        try:
            yield
        except OSError as error:
            with suppress(OSError):  # it has the same samples to write, and the same error
                self._file.close()
            reason = f"can't be written on: {error.strerror}; what was recorded before can be read"
            raise RecordingError(f"{self.path}: {reason}") from None
