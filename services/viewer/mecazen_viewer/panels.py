"""The panels beside the scene: the lines of the plots, the log, and the table of health."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import rerun as rr
from mecazen.messages import DiagnosticArray, DiagnosticStatus
from mecazen.robot import WHEELS
from mecazen.robots import join_key
from mecazen.text import printable

from mecazen_viewer import layout
from mecazen_viewer.layout import Colour, Entity


class PlotLine(NamedTuple):
    """One line of a plot; lines of the same name have one entry in the legend."""

    name: str
    colour: Colour
    width: float = 1.5


def _error_lines(band: str) -> tuple[PlotLine, ...]:
    return (
        PlotLine(band, layout.GREY, 1.0),
        PlotLine(band, layout.GREY, 1.0),
        PlotLine("as estimated", layout.PURPLE, 1.0),
        PlotLine("true", layout.BLUE, 2.0),
    )


DISTANCE_BAND_M, ANGLE_BAND_DEG = (0.1, -0.1), (10.0, -10.0)
"""Reference lines that keep the scale of the plot when errors are small."""
GOOD_NEES = 3.0, 7.815
"""Mean and 95 % quantile of chi-square with three degrees of freedom."""
REAL_TIME_LEVELS = 0.0, 1.0
COMMANDED = PlotLine("commanded", layout.GREY, 3.0)
ROBOT_PLOTS: dict[str, tuple[PlotLine, ...]] = {
    layout.DISTANCE: _error_lines("± 0.1 m"),
    layout.ANGLE: _error_lines("± 10°"),
    f"{layout.VELOCITY}/commanded": (COMMANDED,) * 2,
    f"{layout.VELOCITY}/measured": (PlotLine("x", layout.RED), PlotLine("y", layout.BLUE)),
    f"{layout.YAW_RATE}/commanded": (COMMANDED,),
    f"{layout.YAW_RATE}/measured": (PlotLine("measured", layout.RED),),
    f"{layout.WHEEL_SPEED}/commanded": (COMMANDED,) * len(WHEELS),
    f"{layout.WHEEL_SPEED}/measured": tuple(
        PlotLine(wheel.replace("_", " "), colour)
        for wheel, colour in zip(
            WHEELS, (layout.BLUE, layout.ORANGE, layout.GREEN, layout.RED), strict=True
        )
    ),
    layout.NEES: (
        PlotLine("mean if consistent", layout.GREY),
        PlotLine("95 % if consistent", layout.ORANGE),
        PlotLine("NEES", layout.BLUE),
    ),
}
SHARED_PLOTS: dict[str, tuple[PlotLine, ...]] = {
    layout.REAL_TIME: (
        PlotLine("standstill", layout.GREY),
        PlotLine("real time", layout.GREEN),
        PlotLine("simulated", layout.BLUE, 2.0),
    ),
}


def line_styles(plots: Mapping[str, tuple[PlotLine, ...]]) -> Iterator[Entity]:
    """Return the static names, colours and widths of the lines of plots."""
    for path, lines in plots.items():
        names, colours, widths = zip(*lines, strict=True)
        yield path, rr.SeriesLines(names=names, colors=colours, widths=widths)


LEVELS = (
    rr.TextLogLevel.INFO,
    rr.TextLogLevel.WARN,
    rr.TextLogLevel.ERROR,
    rr.TextLogLevel.WARN,
)
"""Log level of each level of a diagnostic status."""
LEVEL_NAMES = ("ok", "warning", "error", "stale")
STATE_LEVELS = {
    "coasting": rr.TextLogLevel.WARN,
    "searching": rr.TextLogLevel.ERROR,
    "lost": rr.TextLogLevel.ERROR,
    "stop": rr.TextLogLevel.WARN,
    "blind": rr.TextLogLevel.ERROR,
}
"""Log level of states of tracking and guard; that of others is INFO."""

HIDDEN = re.compile(r"refused_payloads|hz/.*|age_s/.*")
"""Values that the table leaves out: the message contains the first, `mecazen status` the others."""
COUNTS = re.compile(r"late/.*|missed_.*|expired_ticks")
"""Counts of what goes wrong; 0 is left out."""
TABLE_HEAD = "| service | health | values |\n| --- | --- | --- |"


class StatusText:
    """Tracking, guard and health of all robots as text; the log holds changes only."""

    def __init__(self) -> None:
        self._logged: dict[str, object] = {}
        self._rows: dict[str, str] = {}

    def state(
        self, service: str, name: str, state: str, reason: str, robot: str
    ) -> Iterator[Entity]:
        """Return a log line if a state that a service of a robot reports has changed."""
        name = join_key(name, robot)
        if state and self._has_changed(name, state):
            level = STATE_LEVELS.get(state, rr.TextLogLevel.INFO)
            yield _log_line(service, f"{name}: {state} {reason}".rstrip(), level)

    def diagnostics(self, service: str, report: DiagnosticArray, robot: str) -> Iterator[Entity]:
        """Return a log line if the health of a service has changed, and the health of all."""
        name = join_key(service, robot)
        for status in report.status:
            message = status.message
            if status.level == 0 and any(pair.key == "walk_ended" for pair in status.values):
                message = "the walk has ended"
            if self._has_changed(f"diagnostics/{name}", (status.level, message)):
                yield _log_line(service, f"{name}: {message}", LEVELS[status.level])
            self._rows[name] = _table_row(name, status)
        text = "\n".join((TABLE_HEAD, *(self._rows[name] for name in sorted(self._rows))))
        yield layout.HEALTH, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)

    def _has_changed(self, name: str, state: object) -> bool:
        before, self._logged[name] = self._logged.get(name), state
        return before != state


def _log_line(source: str, line: str, level: rr.TextLogLevel) -> Entity:
    return f"{layout.LOG}/{source}", rr.TextLog(printable(line), level=level)


def _table_row(name: str, status: DiagnosticStatus) -> str:
    """Return name, level and values of a service, with all Markdown of the values escaped."""
    values = [
        f"{pair.key} {_short(pair.value)}"
        for pair in status.values
        if not HIDDEN.fullmatch(pair.key) and not (COUNTS.fullmatch(pair.key) and pair.value == "0")
    ]
    if status.level:
        values.insert(0, status.message)
    text = re.sub(r"([\\`*_{}\[\]<>()#+!|~&$^])", r"\\\1", printable(", ".join(values)))
    return f"| {name} | {LEVEL_NAMES[status.level]} | {text} |"


def _short(value: str) -> str:
    """Return a number with four digits; other text unchanged."""
    try:
        return f"{float(value):.4g}"
    except ValueError:
        return value
