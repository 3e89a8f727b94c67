"""Figures of motion capture: angles over the gait cycle, and a polar map of the knee's error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from mecazen.errors import MecazenError
from mecazen_tools.drawing import BLUE, COLUMN_IN, DASHES, ORANGE, STYLE, save

from mecazen_experiments.mocap import Place, Row
from mecazen_experiments.quality import MEASURED, Curves
from mecazen_experiments.table import Floats

SHOWN = 2.0, 1.0
"""Standoff [m] and speed [m/s] whose curves are shown, or the nearest that there are."""
PERCENT = np.linspace(0.0, 100.0, 51)
"""Of the gait cycle."""
WEDGE_RAD = math.radians(40.0)
STAGES = "raw", "refined"
LINES: dict[str, dict[str, Any]] = {
    "truth": {"color": "black", "linewidth": 1.0},
    "raw": {"color": ORANGE, "linestyle": DASHES, "linewidth": 1.0},
    "refined": {"color": BLUE, "linewidth": 1.0},
}


def draw_into(
    folder: Path,
) -> Callable[[Sequence[Row], Mapping[Place, Curves]], list[Path]]:
    """Return what writes both figures into a folder, which is made.

    Raises:
        MecazenError: It can't be.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MecazenError(f"--out {folder}: {error.strerror}") from None
    return partial(draw, folder)


def draw(folder: Path, rows: Sequence[Row], curves: Mapping[Place, Curves]) -> list[Path]:
    """Write both figures as PNG, and return the files."""
    figures = {"mocap_cycles": cycles(curves), "mocap_views": views(rows)}
    files = []
    for name, figure in figures.items():
        files.append(folder / f"{name}.png")
        save(figure, files[-1])
    return files


def cycles(curves: Mapping[Place, Curves]) -> Figure:
    """Return the angles over the gait cycle by view: means of both legs' strides, and their SD."""
    nearest = {
        view: min(
            (place for place in curves if place.view == view),
            key=lambda place: math.dist(place[1:3], SHOWN),
        )
        for view in dict.fromkeys(place.view for place in curves)
    }
    with style.context(STYLE):
        size = 2.0 * COLUMN_IN, COLUMN_IN
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(3, len(nearest), sharex=True, sharey="row", squeeze=False)
        for column, (view, place) in enumerate(nearest.items()):
            for row, joint in enumerate(MEASURED):
                axes = grid[row][column]
                _draw_cycle(axes, curves[place], row)
                if column == 0:
                    axes.set_ylabel(f"{joint} [°]")
            title = f"{view}, {place.standoff_m:g} m, {place.speed_m_s:g} m/s"
            grid[0][column].set_title(title)
            grid[-1][column].set_xlabel("gait cycle [%]")
        handles, labels = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def views(rows: Sequence[Row]) -> Figure:
    """Return the knee's error by bearing and standoff about the person, raw and refined."""
    found = {stage: _mean_by_place(rows, f"{stage}_knee_deg") for stage in STAGES}
    most = max(value for of in found.values() for value in of.values())
    standoffs = sorted({row.standoff_m for row in rows})
    # the rings of all standoffs are as wide
    edges = {standoff: (n + 1.0, n + 2.0) for n, standoff in enumerate(standoffs)}
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, COLUMN_IN), layout="constrained")
        both = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
        for axes, stage in zip(both, STAGES, strict=True):
            assert isinstance(axes, PolarAxes)
            axes.set(title=f"knee, {stage}: RMSE [°]", theta_zero_location="N")
            names = {math.radians(row.bearing_deg): row.view.replace("_", " ") for row in rows}
            axes.set_xticks([])
            axes.set_yticks([])
            axes.grid(visible=False)
            axes.spines["polar"].set_visible(False)
            for (bearing, standoff), value in found[stage].items():
                low, high = edges[standoff]
                colour = _colour(value / most)
                axes.bar(bearing, high - low, WEDGE_RAD, low, color=colour, edgecolor="white")
                ink = "black" if value < 0.6 * most else "white"
                place: dict[str, Any] = {"ha": "center", "va": "center", "color": ink}
                axes.text(bearing, (low + high) / 2.0, f"{value:.1f}", **place)
            for standoff, (low, high) in edges.items():
                axes.text(math.radians(45.0), (low + high) / 2.0, f"{standoff:g} m", ha="center")
            axes.plot(0.0, 0.0, marker=(3, 0, 0), color="black", markersize=5.0)
            outer = max(high for _, high in edges.values())
            for bearing, name in names.items():
                axes.text(bearing, outer + 1.0, name, ha="center", va="center")
            axes.set_ylim(0.0, outer + 1.1)
    return figure


def _draw_cycle(axes: Axes, curves: Curves, joint: int) -> None:
    axes.set_xlim(0.0, 100.0)
    for name, line in LINES.items():
        if name in curves.angles:
            strides = by_stride(curves.phases, curves.angles[name][:, [joint, joint + 3]])
            mean, deviation = strides.mean(axis=0), strides.std(axis=0)
            axes.plot(PERCENT, mean, label=name, **line)
            if name == "raw":
                band = mean - deviation, mean + deviation
                axes.fill_between(PERCENT, *band, color=ORANGE, alpha=0.25, linewidth=0.0)


def by_stride(phases: Floats, angles: Floats) -> Floats:
    """Return an angle at `PERCENT` of every whole stride (strides, 51), of both legs.

    Phases and angles (n, 2) are the left and the right leg's at frames; angles may be NaN.
    """
    strides = []
    for phase, angle in zip(phases.T, angles.T, strict=True):
        known = ~np.isnan(angle)
        progress = np.unwrap(phase, period=1.0)
        for begin in range(math.ceil(progress[0]), math.floor(progress[-1])):
            at = begin + PERCENT / 100.0
            strides.append(np.interp(at, progress[known], angle[known]))
    return np.array(strides)


def _mean_by_place(rows: Sequence[Row], name: str) -> dict[tuple[float, float], float]:
    """Return the mean of a score over all speeds, by bearing [rad] and standoff [m]."""
    values: dict[tuple[float, float], list[float]] = {}
    for row in rows:
        if name in row.means:
            place = math.radians(row.bearing_deg), row.standoff_m
            values.setdefault(place, []).append(row.means[name].mean)
    return {place: fmean(of) for place, of in values.items()}


def _colour(share: float) -> tuple[float, float, float]:
    """Return a colour from white to the blue of the lines, for 0 to 1."""
    blue = tuple(int(BLUE[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    red, green, last = (1.0 - share * (1.0 - part) for part in blue)
    return red, green, last
