"""The paper's figures 5 and 8 from our own runs, for print in one column.

The paper is A Virtual Mecanum Wheeled Robot ROS Simulator for Multi-view Self-Following and
Self-Following Motion Capture. The runs come as the tables "back without", "back with",
"side without" and "side with" (optimisation).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from mecazen.config import FollowerConfig
from mecazen_tools.drawing import BLUE, COLUMN_IN, DASHES, ORANGE, STYLE, draw_arrows, save
from mecazen_tools.table import Table, deviations

STANDOFFS = {
    "back": FollowerConfig(view="back").standoff,
    "side": FollowerConfig(view="side_left").standoff,
}
"""The paper's two views, and their standoffs."""

KINDS: dict[str, dict[str, Any]] = {
    "without": {"color": ORANGE, "linestyle": DASHES, "linewidth": 1.0, "zorder": 3.0},
    "with": {"color": BLUE, "linewidth": 0.6},
}
"""Runs without and with optimisation."""

ARROW_EVERY_S = 6.0
ARROW_LENGTH_M, ARROW_WIDTH_M = 0.7, 0.09


def draw(tables: Mapping[str, Table], folder: Path) -> list[Path]:
    """Write both figures into `folder`, as PNG and as SVG, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"fig5_trajectories": trajectories(tables), "fig8_errors": errors(tables)}
    files = []
    for name, figure in figures.items():
        for kind in ("png", "svg"):
            files.append(folder / f"{name}.{kind}")
            save(figure, files[-1])
    return files


def trajectories(tables: Mapping[str, Table]) -> Figure:
    """Return the paper's Fig. 5: the paths of person and robot in world, one panel per run."""
    with style.context(STYLE):
        figure = Figure(figsize=(COLUMN_IN, 0.72 * COLUMN_IN), layout="constrained")
        grid = figure.subplots(2, 2, sharex=True, sharey=True)
        panels = ((kind, view) for kind in KINDS for view in STANDOFFS)
        for axes, letter, (kind, view) in zip(grid.flat, "abcd", panels, strict=True):
            _draw_paths(axes, tables[f"{view} {kind}"])
            axes.set(title=f"({letter}) {view}, {kind}", xlabel="x [m]", ylabel="y [m]")
            axes.label_outer()
        _legend(figure)
    return figure


def errors(tables: Mapping[str, Table]) -> Figure:
    """Return the paper's Fig. 8: errors of distance and angle over time, without and with."""
    with style.context(STYLE):
        figure = Figure(figsize=(COLUMN_IN, 0.8 * COLUMN_IN), layout="constrained")
        grid = figure.subplots(2, 2, sharex=True, sharey="col")
        for (view, standoff), row, letters in zip(
            STANDOFFS.items(), grid, ("ab", "cd"), strict=True
        ):
            for kind, line in KINDS.items():
                table = tables[f"{view} {kind}"]
                distance, _, yaw = deviations(table, standoff)
                row[0].plot(table["t_s"], distance, label=kind, **line)
                row[1].plot(table["t_s"], np.degrees(yaw), label=kind, **line)
            row[0].set(title=f"({letters[0]}) {view}, distance", ylabel="error [m]")
            row[1].set(title=f"({letters[1]}) {view}, angle", ylabel="error [°]")
        for axes in grid[1]:
            axes.set_xlabel("t [s]")
        _legend(figure)
    return figure


def _draw_paths(axes: Axes, table: Table) -> None:
    """Draw the person with an arrow at the start, and the robot with arrows along its path."""
    person, robot = table.poses("target"), table.poses("robot")
    dashed: dict[str, Any] = {"color": ORANGE, "linestyle": DASHES, "linewidth": 1.0}
    axes.plot(*person[:2], label="person, direction at the start", **dashed)
    axes.plot(*robot[:2], color=BLUE, linewidth=0.8, label="robot, heading")
    every = slice(None, None, round(ARROW_EVERY_S / table.tick_s))
    shape = ARROW_LENGTH_M, ARROW_WIDTH_M
    draw_arrows(axes, table.where(every).poses("robot"), BLUE, *shape)
    draw_arrows(axes, table.where(slice(1)).poses("target"), ORANGE, *shape)
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(2.0))


def _legend(figure: Figure) -> None:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
