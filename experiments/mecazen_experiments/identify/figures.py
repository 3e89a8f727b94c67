"""Figures of an identification: the lateral gain by session, and residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from mecazen_tools.drawing import BLUE, COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE, save

from mecazen_experiments.identify.identification import (
    Identification,
    Residuals,
    SessionResult,
    mean_gain,
)
from mecazen_experiments.identify.models import ROLLER_COUNTS, rollers_gain
from mecazen_experiments.identify.runs import Array
from mecazen_experiments.identify.validate import Validation
from mecazen_experiments.statistics import Interval


def draw(found: Identification, residuals: Residuals, folder: Path) -> list[Path]:
    """Write the figures of an identification into a folder; return the files."""
    return write(
        {"lateral_gain": lateral_gain(found.sessions), "residuals": residual_plots(residuals)},
        folder,
    )


def write(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """Write figures as PNG into a folder; return the files."""
    files = []
    for name, figure in figures.items():
        files.append(folder / f"{name}.png")
        save(figure, files[-1], "--out")
    return files


def lateral_gain(sessions: Sequence[SessionResult]) -> Figure:
    """Return lateral over forward gain by session, beside the gain of wheels with N rollers."""
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.9 * COLUMN_IN), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        kinds = list(dict.fromkeys(one.session.split("_")[0] for one in sessions))
        for kind, colour in zip(kinds, PALETTE, strict=False):
            own = [(i, s) for i, s in enumerate(sessions) if s.session.split("_")[0] == kind]
            values, bars = _bars([session.lateral_gain for _, session in own])
            at = [position for position, _ in own]
            left.errorbar(at, values, bars, fmt="o", ms=2.5, lw=0.8, color=colour, label=kind)
        names = [one.session.split("_")[-1] for one in sessions]
        left.set_xticks(range(len(names)), names, rotation=90)
        left.set(xlabel="session", ylabel="lateral over forward gain")
        left.legend(loc="upper left")
        counts = list(ROLLER_COUNTS)
        right.plot(counts, [rollers_gain(n) for n in counts], "o", ms=2.5, color=ORANGE)
        mean = mean_gain(sessions)
        for axes in (left, right):
            axes.axhspan(*mean.ends, color=BLUE, alpha=0.2, lw=0.0)
            axes.axhline(1.0, color="black", lw=0.5, ls=DASHES)
        right.annotate("ideal kinematics", (5.0, 1.0), (0, -7), textcoords="offset points")
        right.set(xlabel="rollers in contact per turn, N", title="sin(π/N)/(π/N)", xticks=counts)
        left.set_title("mean over sessions with its 95 % interval as a band")
    return figure


def residual_plots(residuals: Residuals) -> Figure:
    """Return residuals of position and yaw of the windows of each group."""
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.9 * COLUMN_IN), layout="constrained")
        columns = figure.subplots(1, 3)
        names = ("x [mm]", "y [mm]", "yaw [mrad]")
        for index, (axes, name) in enumerate(zip(columns, names, strict=True)):
            for (group, values), colour in zip(residuals.items(), PALETTE, strict=False):
                shown = 1e3 * values[:, index]
                edges = np.linspace(*_range([1e3 * v[:, index] for v in residuals.values()]), 61)
                axes.hist(
                    shown, edges, density=True, histtype="step", lw=0.8, color=colour, label=group
                )
            axes.set(xlabel=f"residual of {name}", yticks=[])
        columns[0].set_ylabel("density of windows")
        handles, labels = columns[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _range(values: Sequence[Array]) -> tuple[float, float]:
    low, high = np.percentile(np.concatenate(values), [0.5, 99.5])
    return float(low), float(high)


def drift_by_model(found: Validation) -> Figure:
    """Return the median drift of each model after the longest time, with its interval."""
    longest = max(one.horizon_s for one in found.drifts)
    shown = [one for one in found.drifts if one.horizon_s == longest]
    models = list(dict.fromkeys(one.model for one in shown))
    kinds = list(dict.fromkeys(one.kind for one in shown))
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.9 * COLUMN_IN), layout="constrained")
        axes = figure.subplots()
        for index, (kind, colour) in enumerate(zip(kinds, PALETTE, strict=False)):
            own = {one.model: one.position_median_m for one in shown if one.kind == kind}
            at = [position + 0.2 * index - 0.1 for position in range(len(models))]
            values, bars = _bars([own[model] for model in models], 1e3)
            axes.errorbar(values, at, xerr=bars, fmt="o", ms=3.0, lw=0.8, color=colour, label=kind)
        axes.set_yticks(range(len(models)), models)
        axes.invert_yaxis()
        axes.set(xlabel=f"median drift after {longest:g} s [mm]", xlim=(0.0, None))
        axes.legend(loc="lower right")
    return figure


def _bars(intervals: Sequence[Interval], scale: float = 1.0) -> tuple[list[float], list[float]]:
    """Return the means, and the lengths of the error bars on both sides."""
    means = [scale * one.mean for one in intervals]
    return means, [scale * one.ends[1] - mean for one, mean in zip(intervals, means, strict=True)]
