"""The plots: their lines, and their values from messages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import rerun as rr
from mecazen.geometry import Pose2D, Standoff, Twist2D, wrap
from mecazen.robot import WHEELS

from mecazen_viewer import entities as e
from mecazen_viewer.components import scalars
from mecazen_viewer.entities import Colour, Entity


class Line(NamedTuple):
    """One line of a plot."""

    name: str
    colour: Colour
    width: float = 1.5


def _error_lines(band: str) -> tuple[Line, ...]:
    return (
        Line(band, e.GREY, 1.0),
        Line(band, e.GREY, 1.0),
        Line("as estimated", e.PURPLE, 1.0),
        Line("true", e.BLUE, 2.0),
    )


COMMANDED = Line("commanded", e.GREY, 3.0)
"""Lines of the same name have one entry in the legend."""
LINES: dict[str, tuple[Line, ...]] = {
    e.DISTANCE: _error_lines("± 0.1 m"),
    e.ANGLE: _error_lines("± 10°"),
    f"{e.VELOCITY}/commanded": (COMMANDED,) * 2,
    f"{e.VELOCITY}/measured": (Line("x", e.RED), Line("y", e.BLUE)),
    f"{e.YAW_RATE}/commanded": (COMMANDED,),
    f"{e.YAW_RATE}/measured": (Line("measured", e.RED),),
    f"{e.WHEEL_SPEED}/commanded": (COMMANDED,) * len(WHEELS),
    f"{e.WHEEL_SPEED}/measured": tuple(
        Line(wheel.replace("_", " "), colour)
        for wheel, colour in zip(WHEELS, (e.BLUE, e.ORANGE, e.GREEN, e.RED), strict=True)
    ),
    e.NEES: (
        Line("mean if consistent", e.GREY),
        Line("95 % if consistent", e.ORANGE),
        Line("NEES", e.BLUE),
    ),
}
"""Plots of each robot."""
TIME_LINES: dict[str, tuple[Line, ...]] = {
    e.REAL_TIME: (
        Line("standstill", e.GREY),
        Line("real time", e.GREEN),
        Line("simulated", e.BLUE, 2.0),
    ),
}
"""Plots of the simulation."""

DISTANCE_BAND_M, ANGLE_BAND_DEG = (0.1, -0.1), (10.0, -10.0)
"""Reference lines that keep the scale of the plot when errors are small."""
GOOD_NEES = 3.0, 7.815
"""Mean and 95 % quantile of chi-square with three degrees of freedom."""


def styles(plots: Mapping[str, tuple[Line, ...]]) -> Iterator[Entity]:
    """Return the static names, colours and widths of the lines of plots."""
    for path, lines in plots.items():
        names, colours, widths = zip(*lines, strict=True)
        yield path, rr.SeriesLines(names=names, colors=colours, widths=widths)


def errors(
    standoff: Standoff,
    seen: Pose2D | None,
    distance_error: float = math.nan,
    heading_error: float = math.nan,
) -> Iterator[Entity]:
    """Return the errors of distance [m] and heading [deg], true and as the follower estimates them.

    `seen` is the true pose of the robot in the person's frame, None if unknown.
    """
    distance = angle = math.nan
    if seen is not None:
        distance = math.hypot(seen.x, seen.y) - standoff.distance
        angle = wrap(seen.yaw - standoff.heading)
    yield e.DISTANCE, scalars([*DISTANCE_BAND_M, distance_error, distance])
    estimated, true = math.degrees(heading_error), math.degrees(angle)
    yield e.ANGLE, scalars([*ANGLE_BAND_DEG, estimated, true])


def velocity(kind: str, twist: Twist2D) -> Iterator[Entity]:
    """Return a body velocity, `commanded` or `measured`."""
    yield f"{e.VELOCITY}/{kind}", scalars([twist.x, twist.y])
    yield f"{e.YAW_RATE}/{kind}", scalars([twist.yaw])


def wheel_speeds(kind: str, speeds: Iterable[float]) -> Entity:
    """Return the wheel speeds [rad/s] in the order of `WHEELS`, `commanded` or `measured`."""
    return f"{e.WHEEL_SPEED}/{kind}", scalars(speeds)


def consistency(nees: float) -> Entity:
    """Return the estimator's NEES and its reference values."""
    return e.NEES, scalars([*GOOD_NEES, nees])


def real_time(factor: float) -> Entity:
    """Return the real-time factor: simulated over wall time."""
    return e.REAL_TIME, scalars([0.0, 1.0, factor])
