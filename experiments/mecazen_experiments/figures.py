"""Figures of a study: scores of many runs, or single runs over space and time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
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
from mecazen_tools.table import Floats, Table, deviations

from mecazen_experiments.expansion import Job
from mecazen_experiments.frame import select
from mecazen_experiments.gait.motion import MEASURED
from mecazen_experiments.mocap import Capture, capture
from mecazen_experiments.runs import Workers, do_all
from mecazen_experiments.study import Study, StudyFigure
from mecazen_experiments.tables import unit_means

FirstRuns = Sequence[tuple[Job, Any]]
"""The first run of each row of a figure, in the order of the frame, with what its kind needs."""

FORMATS = "png", "svg"
ARROW_EVERY_S = 6.0
ARROW_LENGTH_M, ARROW_WIDTH_M = 0.7, 0.09
PERCENT = np.linspace(0.0, 100.0, 51)
"""Points of the gait cycle."""
CYCLES: dict[str, dict[str, Any]] = {
    "truth": {"color": "black", "linewidth": 1.0},
    "raw": {"color": ORANGE, "linestyle": DASHES, "linewidth": 1.0},
    "refined": {"color": BLUE, "linewidth": 1.0},
}
"""Lines of the stages of a walk."""
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
        for key in chosen["key"]:
            first.setdefault(by_key[key].row, by_key[key])
        todo = [*first.values()]
        draw_kind, work = KINDS[spec.kind]
        results = {job.key: result for job, result in do_all(work, todo, workers)} if work else {}
        with style.context(STYLE):
            drawn = draw_kind(spec, chosen, [(job, results.get(job.key)) for job in todo])
        for suffix in FORMATS:
            file = folder / f"{spec.name}.{suffix}"
            save(drawn, file)
            yield file


def points(spec: StudyFigure, frame: pd.DataFrame, runs: FirstRuns) -> figure.Figure:
    """Draw means with 95 % intervals at each x: a panel for each y, a colour for each `by`."""
    del runs
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
                x: mean_interval([*unit_means(rows, spec.unit, name).values()])
                for x, rows in group.groupby(spec.x, sort=False)
            }
            means = [interval.mean for interval in at.values()]
            bars = [
                [interval.mean - interval.ends[0] for interval in at.values()],
                [interval.ends[1] - interval.mean for interval in at.values()],
            ]
            line: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 2.5}
            axes.errorbar([*at], means, bars, label=word, capsize=2.0, **line)
    drawn.suptitle(spec.title)
    if spec.by:
        _legend(drawn)
    return drawn


def paths(spec: StudyFigure, frame: pd.DataFrame, runs: FirstRuns) -> figure.Figure:
    """Draw the paths of person and robot in world, one panel for the first run of each row."""
    del spec, frame
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


def errors(spec: StudyFigure, frame: pd.DataFrame, runs: FirstRuns) -> figure.Figure:
    """Draw the errors of distance and angle over time: a row for each x, a line for each `by`."""
    del frame
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


def cycles(spec: StudyFigure, frame: pd.DataFrame, runs: FirstRuns) -> figure.Figure:
    """Draw angles over the gait cycle, a column for the first run of each row.

    Lines are means over the strides of both legs; the band of `raw` is one standard deviation.
    """
    del spec, frame
    drawn = figure.Figure(figsize=(2.0 * COLUMN_IN, COLUMN_IN), layout="constrained")
    grid = drawn.subplots(len(MEASURED), len(runs), sharex=True, sharey="row", squeeze=False)
    for column, (job, walk) in zip(grid.T, runs, strict=True):
        phases, angles = walk.truth_at_frames.phases, walk.angles
        for joint, axes in enumerate(column):
            for name in (name for name in CYCLES if name in angles):
                strides = by_stride(phases, angles[name][:, [joint, joint + len(MEASURED)]])
                mean, deviation = strides.mean(axis=0), strides.std(axis=0)
                axes.plot(PERCENT, mean, label=name, **CYCLES[name])
                if name == "raw":
                    band = mean - deviation, mean + deviation
                    axes.fill_between(PERCENT, *band, color=ORANGE, alpha=0.25, linewidth=0.0)
        column[0].set(title=", ".join(map(str, job.labels.values())), xlim=(0.0, 100.0))
        column[-1].set_xlabel("gait cycle [%]")
    for label, axes in zip(MEASURED, grid[:, 0], strict=True):
        axes.set_ylabel(f"{label} [°]")
    _legend(drawn)
    return drawn


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


def captured(job: Job) -> Capture:
    """Simulate a job and return its captured walk."""
    return capture(job.load())


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


KINDS: dict[
    str,
    tuple[
        Callable[[StudyFigure, pd.DataFrame, FirstRuns], figure.Figure],
        Callable[[Job], Any] | None,
    ],
] = {
    "cycles": (cycles, captured),
    "points": (points, None),
    "paths": (paths, tabulate),
    "errors": (errors, tabulate),
}
"""How each kind of figure is drawn, and what it needs of the first run of each row."""
