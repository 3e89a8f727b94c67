"""Structured logs: one line an event, `key=value` pairs, with simulated time."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable


class SimTimeFormatter(logging.Formatter):
    """Formats as `t=12.340 level=warning service=physics msg=…`."""

    def __init__(self, service: str, time_s: Callable[[], float]) -> None:
        """Take the service's name and what tells simulated time [s]."""
        super().__init__()
        self._service = service
        self._time_s = time_s

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line."""
        line = (
            f"t={self._time_s():.3f} level={record.levelname.lower()} service={self._service} "
            f"{record.getMessage()}"
        )
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


def set_up(service: str, time_s: Callable[[], float], level: int = logging.INFO) -> None:
    """Send logs of a level and above to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(SimTimeFormatter(service, time_s))
    logging.basicConfig(level=level, handlers=[handler], force=True)
