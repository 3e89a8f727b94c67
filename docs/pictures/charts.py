"""Charts of published results: Table II, runs of its cases, and engines by cost and error."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator
from mecazen.loading import load_table
from mecazen_experiments.config import Experiment, experiment_path
from mecazen_experiments.figures import KINDS, STANDOFFS
from mecazen_experiments.jobs import expand
from mecazen_experiments.run import tabulate
from mecazen_tools.drawing import BLUE, COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE, draw_arrows, save
from mecazen_tools.table import Table, deviations

ROOT = Path(__file__).parents[2]
GREEN, GREY = PALETTE[2], "#9aa4ae"
VARIANTS = {
    "paper without": ("#e3c27a", "paper, without"),
    "ours without": (ORANGE, "ours, without"),
    "paper with": ("#8fbbd9", "paper, with"),
    "ours with": (BLUE, "ours, with"),
    "ours best": (GREEN, "ours, best"),
}
"""Colour and label of each column of Table II."""
CELL = re.compile(r"([\d.]+)(?: \(([\d.]+)–([\d.]+)\))?")
MISS = 0.2
"""Relative difference from the published figure beyond which ours is marked as missed."""
BEST: dict[str, Any] = {"color": GREEN, "linewidth": 0.9, "zorder": 4.0}
ARROW_EVERY_S, ARROW_M = 6.0, (0.7, 0.09)
ENGINES = {"mecazen": BLUE, "MuJoCo": ORANGE, "Gazebo": GREY}
PEERS = re.compile(r"nexus (\d) ms (\w+)(?:, (capsule|mesh))?(?:, (.+))?")
GAINS = "forward", "lateral / predicted", "yaw / predicted"
MARKERS = {None: "o", "not projected": "D", "elliptic": "^", "elliptic, noslip": "v"}
SIZES = {"1": 3.5, "5": 6.5}
COSTS, ERRORS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2), (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
"""Ticks of the logarithmic axes."""


class Cell(NamedTuple):
    """A figure and its interval; NaN without an interval."""

    value: float
    low: float
    high: float


def table2(file: Path) -> None:
    """Draw Table II of docs/results.md as bars with intervals."""
    rows = read_table((ROOT / "docs" / "results.md").read_text())
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.75 * COLUMN_IN), layout="constrained")
        panels = figure.subplots(1, len(rows))
        for axes, (name, cells) in zip(panels, rows.items(), strict=True):
            _draw_bars(axes, name, cells)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    save(figure, file)


def read_table(page: str) -> dict[str, dict[str, Cell]]:
    """Return the cells of Table II by row and column of a page."""
    table = page.partition("<!-- results: table2 Table II -->")[2].partition("<!-- /results -->")[0]
    head, _, *body = [
        [cell.strip(" *") for cell in line.strip("|").split("|")]
        for line in table.splitlines()
        if line.startswith("|")
    ]
    return {name: dict(zip(head[1:], map(_cell, cells), strict=True)) for name, *cells in body}


def _cell(text: str) -> Cell:
    found = CELL.fullmatch(text)
    assert found is not None, text
    return Cell(*(math.nan if part is None else float(part) for part in found.groups()))


def _draw_bars(axes: Axes, name: str, cells: dict[str, Cell]) -> None:
    for at, (variant, (color, label)) in enumerate(VARIANTS.items()):
        value, low, high = cells[variant]
        axes.bar(at, value, 0.8, color=color, label=label)
        if not math.isnan(low):
            around = [[value - low], [high - value]]
            axes.errorbar(at, value, around, color="black", linewidth=0.8, capsize=2.0)
        paper = cells.get(variant.replace("ours", "paper"))
        if paper is not None and abs(value - paper.value) > MISS * paper.value:
            axes.annotate("missed", (at - 0.4, value), (0.0, 6.0), textcoords="offset points")
    axes.set(title=name, xticks=[])
    axes.grid(visible=False, axis="x")


def best(file: Path) -> None:
    """Draw the runs of the paper's figures 5 and 8 with those of the default follower."""
    tables = dict(_first_runs())
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 1.15 * COLUMN_IN), layout="constrained")
        grid = figure.subplots(2, 3, width_ratios=(1.1, 1.0, 1.0))
        for row, (view, standoff) in zip(grid, STANDOFFS.items(), strict=True):
            _draw_path(row[0], tables[f"{view} best"])
            row[0].set(title=f"{view}, best", xlabel="x [m]", ylabel="y [m]")
            for kind, line in (*KINDS.items(), ("best", BEST)):
                table = tables[f"{view} {kind}"]
                distance, _, yaw = deviations(table, standoff)
                row[1].plot(table["t_s"], distance, label=kind, **line)
                row[2].plot(table["t_s"], np.degrees(yaw), label=kind, **line)
            row[1].set(title=f"{view}, distance", xlabel="t [s]", ylabel="error [m]")
            row[2].set(title=f"{view}, angle", xlabel="t [s]", ylabel="error [°]")
        handles, labels = grid[0][1].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    save(figure, file)


def _first_runs() -> Iterator[tuple[str, Table]]:
    """Yield the run with the first seed of each case, by its name."""
    experiment = load_table(experiment_path("table2"), Experiment)
    for series in expand(experiment, [experiment.first_seed]):
        yield series.row, tabulate(series.jobs[0])


def _draw_path(axes: Axes, table: Table) -> None:
    dashed: dict[str, Any] = {"color": GREY, "linestyle": DASHES, "linewidth": 1.0}
    axes.plot(*table.poses("target")[:2], **dashed)
    axes.plot(*table.poses("robot")[:2], **BEST)
    every = slice(None, None, round(ARROW_EVERY_S / table.tick_s))
    draw_arrows(axes, table.where(every).poses("robot"), GREEN, *ARROW_M)
    axes.set_aspect("equal")


def engines(file: Path) -> None:
    """Draw `nexus` of results/bench-peers.json: cost against errors of gains and energy."""
    found = json.loads((ROOT / "results" / "bench-peers.json").read_text())
    (bench,) = found["benchmarks"]["peers"]
    labels: dict[str, dict[str, Any]] = {}
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.9 * COLUMN_IN), layout="constrained")
        gains, energy = figure.subplots(1, 2, sharex=True)
        for name, row in bench["rows"].items():
            if (match := PEERS.fullmatch(name)) is None:
                continue
            step, engine, shape, settings = match.groups()
            values = {key: cell["value"] for key, cell in row.items()}
            error = 100.0 * max(abs(values[gain] - 1.0) for gain in GAINS)
            filled = shape != "mesh"
            look: dict[str, Any] = {"color": ENGINES[engine], "linestyle": "none"}
            look |= {"marker": MARKERS[settings], "markersize": SIZES[step]}
            look |= {} if filled else {"markerfacecolor": "white"}
            cost = 1.0 / values["× real time"]
            gains.plot(cost, error, **look)
            energy.plot(cost, abs(values["energy %/s"]), **look)
            if settings is None and step == "1":
                labels[f"{engine}, {shape}" if shape else engine] = look
        gains.set_title("largest error of a gain [%]")
        energy.set_title("energy lost in 1 s of coasting [%]")
        for axes in (gains, energy):
            axes.set(xscale="log", yscale="log", xlabel="processor time of a simulated second [s]")
            for axis, ticks in ((axes.xaxis, COSTS), (axes.yaxis, ERRORS)):
                low, high = axis.get_view_interval()
                axis.set_major_locator(FixedLocator([tick for tick in ticks if low < tick < high]))
                axis.set_major_formatter("{x:g}")
                axis.set_minor_locator(NullLocator())
        plain: dict[str, Any] = {"color": GREY, "linestyle": "none"}
        for settings, marker in MARKERS.items():
            if settings is not None:
                labels[settings] = {**plain, "marker": marker, "markersize": SIZES["1"]}
        for step, size in SIZES.items():
            labels[f"steps of {step} ms"] = {**plain, "marker": "o", "markersize": size}
        handles = [Line2D([], [], label=label, **look) for label, look in labels.items()]
        figure.legend(handles=handles, loc="outside right center")
    save(figure, file)
