"""Diagnostics and tracking state as text: a log of changes, and all newest values."""

from __future__ import annotations

import re
from collections.abc import Iterator

import rerun as rr
from mecazen.messages import DiagnosticArray, DiagnosticStatus, GuardState
from mecazen.robots import join_key
from mecazen.text import printable

from mecazen_viewer import entities as e
from mecazen_viewer.entities import Entity

_LOG = rr.TextLogLevel
LEVELS = _LOG.INFO, _LOG.WARN, _LOG.ERROR, _LOG.WARN
"""Log level of each level of a diagnostic status."""
NAMES = ("ok", "warning", "error", "stale")

HIDDEN = {"refused_payloads"}
"""Values that are not shown: the status contains them."""
HIDDEN_PREFIXES = ("hz/", "age_s/")
"""Details of each input; `mecazen status` shows them."""
TRACKING_LEVELS = {"coasting": rr.TextLogLevel.WARN, "lost": rr.TextLogLevel.ERROR}

GUARD_LEVELS = {"stop": rr.TextLogLevel.WARN, "blind": rr.TextLogLevel.ERROR}


class Health:
    """Keeps the newest state, so that only changes are logged."""

    def __init__(self) -> None:
        self._tracking: dict[str, str] = {}
        self._guard: dict[str, str] = {}
        self._status: dict[str, DiagnosticStatus] = {}

    def tracking(self, state: str, robot: str) -> Iterator[Entity]:
        """Return a log line if the tracking state of a robot has changed."""
        if state != self._tracking.get(robot, ""):
            self._tracking[robot] = state
            level = TRACKING_LEVELS.get(state, rr.TextLogLevel.INFO)
            line = printable(f"{join_key('tracking', robot)}: {state}")
            yield f"{e.LOG}/follower", rr.TextLog(line, level=level)

    def guard(self, state: GuardState, robot: str) -> Iterator[Entity]:
        """Return a log line if the state of a robot's guard has changed."""
        if state.state != self._guard.get(robot, ""):
            self._guard[robot] = state.state
            level = GUARD_LEVELS.get(state.state, rr.TextLogLevel.INFO)
            line = f"{join_key('guard', robot)}: {state.state} {state.reason}".rstrip()
            yield f"{e.LOG}/guard", rr.TextLog(printable(line), level=level)

    def diagnostics(self, service: str, report: DiagnosticArray, robot: str) -> Iterator[Entity]:
        """Return a log line if the health of a service has changed, and the full text."""
        name = join_key(service, robot)
        for status in report.status:
            before = self._status.get(name)
            self._status[name] = status
            if before is None or _summary(before) != _summary(status):
                level, message = _summary(status)
                line = rr.TextLog(printable(f"{name}: {message}"), level=LEVELS[level])
                yield f"{e.LOG}/{service}", line
        yield e.HEALTH, rr.TextDocument(self._text(), media_type=rr.MediaType.MARKDOWN)

    def _text(self) -> str:
        """Return a paragraph for each service, which wraps: a table's cells would be cut off."""
        paragraphs = []
        for name, status in sorted(self._status.items()):
            values = ", ".join(
                _as_text(f"{pair.key} {_short(pair.value)}")
                for pair in status.values
                if pair.key not in HIDDEN and not pair.key.startswith(HIDDEN_PREFIXES)
            )
            paragraphs.append(f"**{name}** {NAMES[status.level]}: {values}")
        return "\n\n".join(paragraphs)


def _summary(status: DiagnosticStatus) -> tuple[int, str]:
    """Return level and message of a status; the end of a walk is a message, too."""
    has_ended = status.level == 0 and any(pair.key == "walk_ended" for pair in status.values)
    return status.level, "the walk has ended" if has_ended else status.message


def _as_text(sent: str) -> str:
    """Return text from the bus with all Markdown characters escaped."""
    return re.sub(r"([\\`*_{}\[\]<>()#+!|~&$^])", r"\\\1", printable(sent))


def _short(value: str) -> str:
    """Return a number with four digits; other text unchanged."""
    try:
        return f"{float(value):.4g}"
    except ValueError:
        return value
