"""Reports from a process to its parent process, over a pipe."""

from __future__ import annotations

import logging
import os
from typing import Literal

import msgspec


class Report(msgspec.Struct, frozen=True):
    """A line on the pipe, as JSON."""

    kind: Literal["forked", "started", "serving", "failed", "ended"]
    """The process exists, works, serves a page at an address, ends with an error, or has ended."""
    text: str = ""
    """Address of the page, or the error in one line."""
    number: int = 0
    """Id of the forked process, or the exit code, which is negative after a signal."""


class Reporter:
    """Writes reports to a file descriptor, or nowhere."""

    def __init__(self, descriptor: int | None) -> None:
        self.descriptor = descriptor

    @property
    def log_level(self) -> int:
        """The log level: only warnings if the parent process receives reports."""
        return logging.INFO if self.descriptor is None else logging.WARNING

    def tell(self, report: Report) -> None:
        """Write a report; stop reporting once the pipe is closed."""
        if self.descriptor is not None:
            try:
                os.write(self.descriptor, msgspec.json.encode(report) + b"\n")
            except OSError:
                self.descriptor = None
