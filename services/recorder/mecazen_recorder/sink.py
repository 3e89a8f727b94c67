"""A file that is intact up to its last sync, also after a crash or on a full disk."""

from __future__ import annotations

import os
from pathlib import Path

from mecazen.errors import MecazenError


class RecordingError(MecazenError):
    """A recording can't be written or read; the message names its file."""


class Sink:
    """Buffers bytes in memory; `sync` writes them to the disk, or leaves the file unchanged.

    Raises:
        RecordingError: The file exists, or can't be created.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._waiting = bytearray()
        self._synced = 0
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except FileExistsError:
            raise RecordingError(f"{path}: exists already, and is not overwritten") from None
        except OSError as error:
            raise RecordingError(f"{path}: can't be written: {error.strerror}") from None

    def write(self, data: bytes) -> None:
        """Buffer bytes."""
        self._waiting += data

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self._synced + len(self._waiting)

    def flush(self) -> None:
        """Do nothing; `sync` writes."""

    def sync(self) -> None:
        """Write everything to the disk.

        Raises:
            RecordingError: Writing failed, most likely on a full disk; the file then ends where
                it ended after the last sync.
        """
        try:
            written = 0
            while written < len(self._waiting):
                written += os.write(self._file, self._waiting[written:])
            os.fsync(self._file)
        except OSError as error:
            os.ftruncate(self._file, self._synced)
            raise RecordingError(
                f"{self._path}: can't be written on: {error.strerror}; "
                f"the {self._synced} bytes recorded so far can be read"
            ) from None
        self._synced += written
        self._waiting.clear()

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)
