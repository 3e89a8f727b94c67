"""A file that is whole up to its last sync, whatever ends the process or fills the disk."""

from __future__ import annotations

import os
from pathlib import Path

from mecazen.errors import MecazenError


class RecordingError(MecazenError):
    """A recording can't be written or read; the message names its file."""


class Sink:
    """Takes bytes in memory; `sync` brings them to the disk, or leaves the file as it was.

    Raises:
        RecordingError: The file exists already, or can't be made.
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
        """Take bytes."""
        self._waiting += data

    def tell(self) -> int:
        """Return the length of all that was taken."""
        return self._synced + len(self._waiting)

    def flush(self) -> None:
        """Do nothing: `sync` does."""

    def sync(self) -> None:
        """Bring everything to the disk.

        Raises:
            RecordingError: It can't be, most often for want of space; the file then ends where
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
