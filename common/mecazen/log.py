"""Structured logs: one line an event, `key=value` pairs, with simulated time."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable


def set_up(service: str, time_s: Callable[[], float], level: int = logging.INFO) -> None:
    """Send logs of a level and above to standard error, with simulated time [s].

    A line is `t=12.340 level=warning service=physics msg=…`.
    """

    def add_time(record: logging.LogRecord) -> bool:
        record.time_s, record.level = time_s(), record.levelname.lower()
        return True

    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(add_time)
    line = f"t=%(time_s).3f level=%(level)s service={service} %(message)s"
    handler.setFormatter(logging.Formatter(line))
    logging.basicConfig(level=level, handlers=[handler], force=True)
