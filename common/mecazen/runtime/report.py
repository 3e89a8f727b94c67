"""What a process tells the one that has started it, on a pipe of their own."""

from __future__ import annotations

import logging
import os
from typing import Literal

import msgspec


class Report(msgspec.Struct, frozen=True):
    """A line on the pipe, in JSON."""

    kind: Literal["forked", "started", "serving", "failed", "ended"]
    """It exists; it works; it serves a page at an address; it ends with an error; it has ended."""
    text: str = ""
    """The address, or the error in one line."""
    number: int = 0
    """Of the process that was forked, or the exit code; that of a signal is negative."""


class Reporter:
    """Writes reports to a file descriptor, or nowhere."""

    def __init__(self, descriptor: int | None) -> None:
        self.descriptor = descriptor

    @property
    def log_level(self) -> int:
        """The level of logs: warnings only where the starting process gets reports."""
        return logging.INFO if self.descriptor is None else logging.WARNING

    def tell(self, report: Report) -> None:
        """Write a report; where nobody reads any more, there is nobody to tell."""
        if self.descriptor is not None:
            try:
                os.write(self.descriptor, msgspec.json.encode(report) + b"\n")
            except OSError:
                self.descriptor = None
