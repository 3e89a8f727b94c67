"""Runs as figures: seen from above, and over time; of compared followers also their measures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import cycle, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from mecazen.config import Scenario
from mecazen.config.world import Box
from mecazen.geometry import Pose2D, Standoff
from mecazen.robots import join_key

from mecazen_tools.drawing import COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE, draw_arrows
from mecazen_tools.table import Table, deviations
from mecazen_tools.trajectory import LOST, TWIST, Trajectory, sentence

if TYPE_CHECKING:
    from mecazen_tools.comparison import Comparison, Runs

ARROWS = 12
"""Number of arrows along the path of each robot."""
LEGEND_COLUMNS = 7
WANTED: dict[str, Any] = {"color": "black", "ls": DASHES, "lw": 0.7, "zorder": 3.0}
WANTED["label"] = "wanted"
OBSTACLE: dict[str, Any] = {"facecolor": "#cccccc", "edgecolor": "#888888", "linewidth": 0.3}
SHADES = {"#f5e6c0": ("coasting",), "#f0c0b0": LOST}
"""Colours of the times in these tracking states."""
ERRORS = {"distance\nerror [m]": 0.05, "heading\nerror [°]": 2.0}
VELOCITIES = {"vx [m/s]": 0.1, "vy [m/s]": 0.1, "wz [rad/s]": 0.1}
"""The panels over time with the minimum range of their axes: rounding must not look like motion."""
DOTS: dict[str, Any] = {"markersize": 2.5, "alpha": 0.5, "markeredgewidth": 0.0}
MEAN: dict[str, Any] = {"fmt": "_", "ms": 5.0, "capsize": 1.5, "lw": 0.7}


class Course(NamedTuple):
    """Motion and commands of a robot and its person in a run."""

    name: str
    """Name of the robot or of the run; empty if there is only one."""
    table: Table
    standoff: Standoff
    person: str = "person"
    """Name of the person."""
    lost: str = ""
    """How long the person was lost, and why."""


def courses(trajectory: Trajectory, run: str = "") -> list[Course]:
    """Return the courses of the robots of a run, which has a name if it is one of several."""
    return [
        Course(
            "/".join(filter(None, (run, robot))),
            trajectory.table(robot),
            trajectory.scenario.of(robot).follower.standoff,
            join_key("person", robot),
            sentence(trajectory.lost(robot)),
        )
        for robot in trajectory.scenario.names
    ]


def draw(runs: Sequence[Course], scenario: Scenario, title: str) -> Figure:
    """Return the figure of courses, with goals as dashed and motion as solid lines.

    Times in which the person is not seen are shaded; a line below says why they were lost.
    Goals and errors are drawn if there is a person. As in the scores, they use the settings of the
    scenario, without later changes of parameters.
    """
    names = {**(ERRORS if any(map(_followed, runs)) else {}), **VELOCITIES}
    with style.context(STYLE):
        figure = Figure(figsize=(2.4 * COLUMN_IN, 1.4 * COLUMN_IN), layout="constrained")
        grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
        above = figure.add_subplot(grid[0])
        panels = list(grid[1].subgridspec(len(names), 1).subplots(sharex=True, squeeze=False)[:, 0])
        _draw_above(above, runs, scenario, title)
        for colour, course in zip(cycle(PALETTE), runs, strict=False):
            table = course.table
            if _followed(course):
                distance, _, heading = deviations(table, course.standoff)
                for axes, error in zip(panels, (distance, np.degrees(heading)), strict=False):
                    axes.plot(table["t_s"], error, color=colour, lw=0.7)
                    axes.axhline(0.0, **WANTED)
            for (shade, states), axes in product(SHADES.items(), panels):
                where, height = np.isin(table.tracking, states), axes.get_xaxis_transform()
                shading = {"color": shade, "label": states[0], "zorder": 0.0, "linewidth": 0.0}
                axes.fill_between(table["t_s"], 0, 1, where, transform=height, **shading)
            commands = table.having("cmd_vx_m_s")
            for name, axes in zip(TWIST, panels[-3:], strict=True):
                axes.plot(table["t_s"], table[f"robot_{name}"], color=colour, lw=1.0)
                # a command holds until the next one
                command = commands["t_s"], commands[f"cmd_{name}"]
                axes.step(*command, where="post", **WANTED | {"lw": 0.4})
        for axes, (name, least) in zip(panels, names.items(), strict=True):
            low, high = axes.get_ylim()
            axes.set(ylabel=name, ylim=(min(low, -least), max(high, least)))
        panels[-1].set_xlabel("t [s]")
        lost = (f"{course.name} {course.lost}".lstrip() for course in runs if course.lost)
        figure.supxlabel("\n".join(lost), fontsize="medium")
        figure.align_ylabels(panels)
        _draw_legend(figure, above, panels[-1])
    return figure


def draw_comparison(
    result: Comparison, runs: Runs, scenario: Scenario, measured: Iterable[str]
) -> Figure:
    """Return the figure of compared followers.

    It shows the paths of the first seed, the errors over time as means with the range of all seeds,
    and the measures of all seeds with their means and 95 % intervals.
    """
    standoff, first = scenario.follower.standoff, min(result.seeds)
    tables = {name: seeds[first].table for name, seeds in runs.items()}
    with style.context(STYLE):
        figure = Figure(figsize=(2.4 * COLUMN_IN, 1.1 * COLUMN_IN), layout="constrained")
        axes_of = figure.subplot_mosaic("ABD;ACE", width_ratios=(1.2, 1.0, 0.7))
        above, *panels = (axes_of[name] for name in "ABCDE")
        distances, headings, *measures = panels
        courses = [Course(name, table, standoff) for name, table in tables.items() if table]
        _draw_above(above, courses, scenario, result.scenario)
        for place, (colour, name) in enumerate(zip(cycle(PALETTE), runs, strict=False)):
            seeds = runs[name].values()
            distance, heading = np.array([run.errors for run in seeds]).swapaxes(0, 1)
            for axes, error in ((distances, distance), (headings, np.degrees(heading))):
                t = np.arange(error.shape[1]) * scenario.sim.tick_s
                axes.fill_between(t, error.min(0), error.max(0), color=colour, alpha=0.2, lw=0.0)
                axes.plot(t, error.mean(0), color=colour, lw=0.7)
            for axes, measure in zip(measures, measured, strict=False):
                values = [run.measures[measure] for run in seeds if measure in run.measures]
                axes.plot([place] * len(values), values, "o", color=colour, **DOTS)
                if (mean := result.means[name].get(measure)) is not None:
                    half = [[mean.high - mean.mean]] * 2
                    axes.errorbar([place + 0.25], [mean.mean], half, **MEAN | {"color": colour})
        for axes, label in zip(panels, (*ERRORS, *measured), strict=False):
            axes.set_ylabel(label)
        for axes in (distances, headings):
            axes.axhline(0.0, **WANTED)
        for axes in measures:
            axes.set(xlim=(-0.5, len(runs) - 0.25), ylim=(0.0, None), xticks=[])
        distances.tick_params(labelbottom=False)
        headings.set_xlabel("t [s]")
        figure.align_ylabels(panels)
        _draw_legend(figure, above)
    return figure


def _draw_above(axes: Axes, runs: Sequence[Course], scenario: Scenario, title: str) -> None:
    for solid in scenario.world.solids:
        if isinstance(solid, Box):
            x, y = solid.size_m[0] / 2, solid.size_m[1] / 2
            box = Pose2D(*solid.position_m, math.radians(solid.yaw_deg))
            corners = (x, y), (-x, y), (-x, -y), (x, -y)
            outline = [box.compose(Pose2D(*corner))[:2] for corner in corners]
            axes.add_patch(Polygon(outline, **OBSTACLE))
        else:
            axes.add_patch(Circle(solid.position_m, solid.size_m[0], **OBSTACLE))
    for colour, course in zip(cycle(PALETTE), runs, strict=False):
        _draw_paths(axes, course, colour)
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title)
    axes.set_aspect("equal", adjustable="datalim")


def _draw_legend(figure: Figure, *panels: Axes) -> None:
    """Draw the legend of some panels above all of them, where it covers nothing."""
    artists = (artist for axes in panels for artist in (*axes.lines, *axes.collections))
    lines = {str(artist.get_label()): artist for artist in artists}
    named = [name for name in lines if name and not name.startswith("_")]
    shown = {name: lines[name] for name in sorted(named, key="wanted".__eq__)}
    columns = min(len(shown), LEGEND_COLUMNS)
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=columns)


def _followed(course: Course) -> bool:
    return not np.isnan(course.table["target_x_m"]).all()


def _draw_paths(axes: Axes, course: Course, colour: str) -> None:
    robot, followed = course.table.poses("robot"), course.table.having("target_x_m")
    if len(followed):
        person = followed.poses("target")
        lighter = (
            {"color": ORANGE} if course.person == "person" else {"color": colour, "alpha": 0.45}
        )
        axes.plot(person.x, person.y, label=course.person, lw=0.7, **lighter)
        axes.plot(person.x[0], person.y[0], "o", markersize=2.5, **lighter)
        goal = person.compose(course.standoff.goal(Pose2D()))
        axes.plot(goal.x, goal.y, **WANTED)
    axes.plot(robot.x, robot.y, color=colour, label=course.name or "robot", lw=0.7)
    places = np.hstack([(robot.x, robot.y), followed.poses("target")[:2]])
    size = max(float(np.nanmax(np.nanmax(places, 1) - np.nanmin(places, 1))), 1.0)
    every = slice(None, None, max(1, len(robot.x) // ARROWS))
    draw_arrows(axes, [column[every] for column in robot], colour, 0.05 * size, 0.006 * size)
