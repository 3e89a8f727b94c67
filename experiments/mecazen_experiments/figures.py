"""Figures of a study: scores of many runs, or single runs over space and time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import figure, style
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator
from mecazen_tools.drawing import (
    BLUE,
    COLUMN_IN,
    DASHES,
    ORANGE,
    PALETTE,
    STYLE,
    draw_arrows,
    save,
)
from mecazen_tools.observe import observe
from mecazen_tools.statistics import mean_interval
from mecazen_tools.table import Table, deviations

from mecazen_experiments.expansion import Job
from mecazen_experiments.frame import select
from mecazen_experiments.runs import Workers, do_all
from mecazen_experiments.study import UNIT, Study, StudyFigure
from mecazen_experiments.tables import unit_means

FirstRuns = Sequence[tuple[Job, Table]]
"""The first run of each row of a figure, in the order of the frame, with every tick of it."""

FORMATS = "png", "svg"
ARROW_EVERY_S = 6.0
ARROW_LENGTH_M, ARROW_WIDTH_M = 0.7, 0.09
LINES: tuple[dict[str, Any], ...] = (
    {"color": ORANGE, "linestyle": DASHES, "linewidth": 1.0, "zorder": 3.0},
    {"color": BLUE, "linewidth": 0.6},
    *({"color": colour, "linewidth": 0.6} for colour in PALETTE[1:]),
)


def draw(
    study: Study, frame: pd.DataFrame, jobs: Sequence[Job], workers: Workers, folder: Path
) -> Iterator[Path]:
    """Draw the figures of a study into a folder, as PNG and as SVG; yield the files."""
    by_key = {job.key: job for job in jobs}
    for spec in study.figures:
        chosen = select(frame, spec.where, f"figure {spec.name!r}: where")
        first: dict[str, Job] = {}
        for key in chosen["key"] if spec.kind != "points" else ():
            first.setdefault(by_key[key].row, by_key[key])
        tables = {job.key: table for job, table in do_all(tabulate, [*first.values()], workers)}
        runs = [(job, tables[job.key]) for job in first.values()]
        with style.context(STYLE):
            match spec.kind:
                case "points":
                    drawn = points(spec, chosen)
                case "paths":
                    drawn = paths(runs)
                case "errors":
                    drawn = errors(spec, runs)
        for suffix in FORMATS:
            file = folder / f"{spec.name}.{suffix}"
            save(drawn, file)
            yield file


def points(spec: StudyFigure, frame: pd.DataFrame) -> figure.Figure:
    """Draw means with 95 % intervals at each x: a panel for each y, a colour for each `by`."""
    size = COLUMN_IN * max(1.0, 0.7 * len(spec.y)), 0.7 * COLUMN_IN
    drawn = figure.Figure(figsize=size, layout="constrained")
    x_label, *y_labels = spec.labels or (spec.x, *spec.y)
    grid = drawn.subplots(1, len(spec.y), squeeze=False)
    for axes, name, label in zip(grid.flat, spec.y, y_labels, strict=True):
        axes.set(xlabel=x_label, ylabel=label)
        known = frame.dropna(subset=[name])
        groups = known.groupby(spec.by, sort=False) if spec.by else [(None, known)]
        for (word, group), colour in zip(groups, cycle(PALETTE), strict=False):
            at = {
                x: mean_interval([*unit_means(rows, UNIT, name).values()])
                for x, rows in group.groupby(spec.x, sort=False)
            }
            means = [interval.mean for interval in at.values()]
            bars = [
                [interval.mean - interval.ends[0] for interval in at.values()],
                [interval.ends[1] - interval.mean for interval in at.values()],
            ]
            line: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 2.5}
            axes.errorbar([*at], means, bars, label=word, capsize=2.0, **line)
    if spec.by:
        _legend(drawn)
    return drawn


def paths(runs: FirstRuns) -> figure.Figure:
    """Draw the paths of person and robot in world, one panel for the first run of each row."""
    drawn = figure.Figure(
        figsize=(COLUMN_IN, 0.36 * COLUMN_IN * len(runs) / 2), layout="constrained"
    )
    grid = drawn.subplots(-(-len(runs) // 2), 2, sharex=True, sharey=True, squeeze=False)
    for axes, letter, (job, table) in zip(grid.flat, "abcdefghijkl", runs, strict=False):
        _draw_paths(axes, table)
        axes.set(title=f"({letter}) {job.row}", xlabel="x [m]", ylabel="y [m]")
        axes.label_outer()
    _legend(drawn)
    return drawn


def errors(spec: StudyFigure, runs: FirstRuns) -> figure.Figure:
    """Draw the errors of distance and angle over time: a row for each x, a line for each `by`."""
    groups = list(dict.fromkeys(str(job.labels[spec.x]) for job, _ in runs))
    size = COLUMN_IN, 0.4 * COLUMN_IN * len(groups)
    drawn = figure.Figure(figsize=size, layout="constrained")
    grid = drawn.subplots(len(groups), 2, sharex=True, sharey="col", squeeze=False)
    for name, panels in zip(groups, grid, strict=True):
        lines = [run for run in runs if run[0].labels[spec.x] == name]
        for (job, table), line in zip(lines, LINES, strict=False):
            distance, _, yaw = deviations(table, job.load().follower.standoff)
            label = str(job.labels[spec.by])
            panels[0].plot(table["t_s"], distance, label=label, **line)
            panels[1].plot(table["t_s"], np.degrees(yaw), label=label, **line)
        panels[0].set(title=f"{name}, distance", ylabel="error [m]")
        panels[1].set(title=f"{name}, angle", ylabel="error [°]")
    for axes in grid[-1]:
        axes.set_xlabel("t [s]")
    _legend(drawn)
    return drawn


def tabulate(job: Job) -> Table:
    """Simulate a job and return every tick of it."""
    return observe(job.load()).table


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


def _legend(drawn: figure.Figure) -> None:
    handles, labels = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside upper center", ncols=len(labels))
