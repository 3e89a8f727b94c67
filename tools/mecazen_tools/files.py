"""Files that commands write: whole, or not at all."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mecazen.errors import MecazenError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer


class WholeWrites(io.FileIO):
    """A file without a buffer that writes all of the data or fails.

    `io.FileIO` writes only what a full disk takes, and `io.TextIOWrapper` drops the rest. A buffer
    would fail again at the exit.
    """

    def write(self, data: Buffer) -> int:
        """Write all of the data."""
        left = memoryview(data).cast("B")
        size = len(left)
        while left:
            left = left[super().write(left) :]
        return size


def make_folder(folder: Path, option: str) -> None:
    """Make a folder, if there is none.

    Raises:
        MecazenError: The folder can't be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MecazenError(f"{option} {folder}: {error.strerror}") from None


def write(path: Path, content: bytes, option: str = "") -> None:
    """Write a file; see `write_with`."""
    write_with(path, lambda part: part.write_bytes(content), option)


def write_with(path: Path, save: Callable[[Path], object], option: str = "") -> None:
    """Let `save` write a file with the suffix of `path`, which then replaces the file at `path`.

    A failure leaves neither half a file nor a changed one. `option` names the file in the message.

    Raises:
        MecazenError: The file can't be written, as on a full disk.
    """
    try:
        if path.exists() and not path.is_file():
            save(path)  # a device, such as /dev/stdout: nothing can take its place
            return
        part = path.with_name(f".{path.stem}.part{path.suffix}")
        try:
            save(part)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise MecazenError(f"{option} {path}: {error.strerror}".strip()) from None
