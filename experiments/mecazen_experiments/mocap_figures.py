"""Figures of motion capture: angles over the gait cycle, and a polar map of the knee's error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from mecazen_tools.drawing import BLUE, COLUMN_IN, DASHES, ORANGE, STYLE, save
from mecazen_tools.table import Floats

from mecazen_experiments.mocap import STANDOFF, VIEW
from mecazen_experiments.quality import MEASURED, Curves, Quality
from mecazen_experiments.report import Row

PERCENT = np.linspace(0.0, 100.0, 51)
"""Points of the gait cycle."""
WEDGE_RAD = math.radians(40.0)
STAGES = "raw", "refined"
LINES: dict[str, dict[str, Any]] = {
    "truth": {"color": "black", "linewidth": 1.0},
    "raw": {"color": ORANGE, "linestyle": DASHES, "linewidth": 1.0},
    "refined": {"color": BLUE, "linewidth": 1.0},
}


def draw(
    folder: Path,
    curves: Mapping[str, Curves],
    rows: Sequence[Row[Quality]],
    bearings: Mapping[str | float, float],
) -> list[Path]:
    """Write both figures as PNG, and return the files.

    `curves` are keyed by the title of their column, `bearings` [rad] by view.
    """
    figures = {"mocap_cycles": cycles(curves), "mocap_views": views(rows, bearings)}
    files = []
    for name, figure in figures.items():
        files.append(folder / f"{name}.png")
        save(figure, files[-1])
    return files


def cycles(curves: Mapping[str, Curves]) -> Figure:
    """Return the angles over the gait cycle by row: means of both legs' strides, and their SD."""
    with style.context(STYLE):
        size = 2.0 * COLUMN_IN, COLUMN_IN
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(3, len(curves), sharex=True, sharey="row", squeeze=False)
        for column, (name, of) in enumerate(curves.items()):
            for row, joint in enumerate(MEASURED):
                axes = grid[row][column]
                _draw_cycle(axes, of, row)
                if column == 0:
                    axes.set_ylabel(f"{joint} [°]")
            grid[0][column].set_title(name)
            grid[-1][column].set_xlabel("gait cycle [%]")
        handles, labels = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def views(rows: Sequence[Row[Quality]], bearings: Mapping[str | float, float]) -> Figure:
    """Return the knee's error by bearing and standoff about the person, raw and refined."""
    found = {stage: _mean_by_place(rows, f"{stage}_knee_deg") for stage in STAGES}
    most = max(value for of in found.values() for value in of.values())
    standoffs = sorted({float(row.labels[STANDOFF]) for row in rows})
    # the rings of all standoffs have the same width
    edges = {standoff: (n + 1.0, n + 2.0) for n, standoff in enumerate(standoffs)}
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, COLUMN_IN), layout="constrained")
        both = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
        for axes, stage in zip(both, STAGES, strict=True):
            assert isinstance(axes, PolarAxes)
            axes.set(title=f"knee, {stage}: RMSE [°]", theta_zero_location="N")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.grid(visible=False)
            axes.spines["polar"].set_visible(False)
            for (view, standoff), value in found[stage].items():
                bearing, (low, high) = bearings[view], edges[standoff]
                colour = _colour(value / most)
                axes.bar(bearing, high - low, WEDGE_RAD, low, color=colour, edgecolor="white")
                ink = "black" if value < 0.6 * most else "white"
                place: dict[str, Any] = {"ha": "center", "va": "center", "color": ink}
                axes.text(bearing, (low + high) / 2.0, f"{value:.1f}", **place)
            for standoff, (low, high) in edges.items():
                axes.text(math.radians(45.0), (low + high) / 2.0, f"{standoff:g} m", ha="center")
            axes.plot(0.0, 0.0, marker=(3, 0, 0), color="black", markersize=5.0)
            outer = max(high for _, high in edges.values())
            for view, bearing in bearings.items():
                name = str(view).replace("_", " ")
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
    """Return an angle at `PERCENT` for every complete stride (strides, 51) of both legs.

    Phases and angles (n, 2) are those of the left and the right leg in n frames; angles may be NaN.
    """
    strides = []
    for phase, angle in zip(phases.T, angles.T, strict=True):
        known = ~np.isnan(angle)
        progress = np.unwrap(phase, period=1.0)
        for begin in range(math.ceil(progress[0]), math.floor(progress[-1])):
            at = begin + PERCENT / 100.0
            strides.append(np.interp(at, progress[known], angle[known]))
    return np.array(strides)


def _mean_by_place(
    rows: Sequence[Row[Quality]], name: str
) -> dict[tuple[str | float, float], float]:
    """Return the mean of a score over all speeds, by view and standoff [m]."""
    values: dict[tuple[str | float, float], list[float]] = {}
    for row in rows:
        if name in row.means:
            place = row.labels[VIEW], float(row.labels[STANDOFF])
            values.setdefault(place, []).append(row.means[name].mean)
    return {place: fmean(of) for place, of in values.items()}


def _colour(share: float) -> tuple[float, float, float]:
    """Return a colour from white to the blue of the lines, for 0 to 1."""
    blue = tuple(int(BLUE[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    red, green, last = (1.0 - share * (1.0 - part) for part in blue)
    return red, green, last
