"""Compared followers as a figure: paths, errors over time, and the measures of all seeds."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from mecazen.config import Scenario

from mecazen_tools.comparison import MEASURES, Runs
from mecazen_tools.drawing import COLUMN_IN, PALETTE, STYLE
from mecazen_tools.run_figure import ERRORS, WANTED, Course, draw_above, draw_legend
from mecazen_tools.statistics import mean_interval

DOTS: dict[str, Any] = {"markersize": 2.5, "alpha": 0.5, "markeredgewidth": 0.0}
MEAN: dict[str, Any] = {"fmt": "_", "ms": 5.0, "capsize": 1.5, "lw": 0.7}


def draw(runs: Runs, scenario: Scenario, title: str) -> Figure:
    """Return the figure of compared followers.

    It shows the paths of the first seed, the errors over time as means with the range of all seeds,
    and the measures of all seeds with their means and 95 % intervals.
    """
    first = min(min(seeds) for seeds in runs.values())
    tables = {name: seeds[first].table for name, seeds in runs.items()}
    standoff = scenario.follower.standoff
    with style.context(STYLE):
        figure = Figure(figsize=(2.4 * COLUMN_IN, 1.1 * COLUMN_IN), layout="constrained")
        axes_of = figure.subplot_mosaic("ABD;ACE", width_ratios=(1.2, 1.0, 0.7))
        above, *panels = (axes_of[name] for name in "ABCDE")
        distances, headings, *measures = panels
        courses = [Course(name, table, standoff) for name, table in tables.items() if table]
        draw_above(above, courses, scenario, title)
        for place, (colour, seeds) in enumerate(zip(cycle(PALETTE), runs.values(), strict=False)):
            errors = np.array([run.errors for run in seeds.values()])
            distance, heading = errors[:, 0], np.degrees(errors[:, 1])
            for axes, error in ((distances, distance), (headings, heading)):
                t = np.arange(error.shape[1]) * scenario.sim.tick_s
                axes.fill_between(t, error.min(0), error.max(0), color=colour, alpha=0.2, lw=0.0)
                axes.plot(t, error.mean(0), color=colour, lw=0.7)
            for axes, name in zip(measures, MEASURES, strict=False):
                values = [run.measures[name] for run in seeds.values() if name in run.measures]
                axes.plot([place] * len(values), values, "o", color=colour, **DOTS)
                if values:
                    mean = mean_interval(values)
                    half = [[mean.high - mean.mean]] * 2
                    axes.errorbar([place + 0.25], [mean.mean], half, **MEAN | {"color": colour})
        for axes, name in zip(panels, (*ERRORS, *MEASURES), strict=False):
            axes.set_ylabel(name)
        for axes in (distances, headings):
            axes.axhline(0.0, **WANTED)
        for axes in measures:
            axes.set(xlim=(-0.5, len(runs) - 0.25), ylim=(0.0, None), xticks=[])
        distances.tick_params(labelbottom=False)
        headings.set_xlabel("t [s]")
        figure.align_ylabels(panels)
        draw_legend(figure, above)
    return figure
