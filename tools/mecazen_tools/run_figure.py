"""One run as a figure: seen from above, and its errors and velocities over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle, product
from typing import Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from mecazen.config import Scenario
from mecazen.config.world import Box
from mecazen.geometry import Pose2D, Standoff
from mecazen.robots import join_key

from mecazen_tools.comparison import MEASURES, Runs
from mecazen_tools.drawing import COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE, draw_arrows
from mecazen_tools.losses import TrackingRow, lost_shares, sentence, spans
from mecazen_tools.statistics import mean_interval
from mecazen_tools.table import Table, deviations
from mecazen_tools.trajectory import TWIST, Trajectory

ARROWS = 12
"""Number of arrows along the path of each robot."""
LEGEND_COLUMNS = 7
WANTED: dict[str, Any] = {"color": "black", "ls": DASHES, "lw": 0.7, "zorder": 3.0}
WANTED["label"] = "wanted"
DOTS: dict[str, Any] = {"markersize": 2.5, "alpha": 0.5, "markeredgewidth": 0.0}
MEAN: dict[str, Any] = {"fmt": "_", "ms": 5.0, "capsize": 1.5, "lw": 0.7}
OBSTACLE: dict[str, Any] = {"facecolor": "#cccccc", "edgecolor": "#888888", "linewidth": 0.3}
SHADES: dict[str, dict[str, Any]] = {
    "coasting": {"facecolor": "#f5e6c0", "zorder": 0.0},
    "lost": {"facecolor": "#f0c0b0", "zorder": 0.0},
}
ERRORS = {"distance\nerror [m]": 0.05, "heading\nerror [°]": 2.0}
VELOCITIES = {"vx [m/s]": 0.1, "vy [m/s]": 0.1, "wz [rad/s]": 0.1}
"""The panels over time with the minimum range of their axes: rounding must not look like motion."""


class Course(NamedTuple):
    """Motion and commands of a robot and its person in a run."""

    name: str
    """Name of the robot or of the run; empty if there is only one."""
    table: Table
    standoff: Standoff
    person: str = "person"
    """Name of the person."""
    tracking: Sequence[TrackingRow] = ()


def courses(trajectory: Trajectory, run: str = "") -> list[Course]:
    """Return the courses of the robots of a run, which has a name if it is one of several."""
    return [
        Course(
            "/".join(filter(None, (run, robot))),
            Table.of(trajectory, robot),
            trajectory.scenario.of(robot).follower.standoff,
            join_key("person", robot),
            trajectory.tracking(robot),
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
        draw_above(above, runs, scenario, title)
        for colour, course in zip(cycle(PALETTE), runs, strict=False):
            table = course.table
            if _followed(course):
                distance, _, heading = deviations(table, course.standoff)
                for axes, error in zip(panels, (distance, np.degrees(heading)), strict=False):
                    axes.plot(table["t_s"], error, color=colour, lw=0.7)
                    axes.axhline(0.0, **WANTED)
            for (begin_s, end_s, state), axes in product(spans(course.tracking), panels):
                axes.axvspan(begin_s, end_s, label=state, **SHADES[state])
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
        lost = {course.name: sentence(lost_shares(course.tracking)) for course in runs}
        figure.supxlabel(
            "\n".join(f"{name} {text}".lstrip() for name, text in lost.items() if text),
            fontsize="medium",
        )
        figure.align_ylabels(panels)
        draw_legend(figure, above, panels[-1])
    return figure


def draw_comparison(runs: Runs, scenario: Scenario, title: str) -> Figure:
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
        shown = [Course(name, table, standoff) for name, table in tables.items() if table]
        draw_above(above, shown, scenario, title)
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


def draw_above(axes: Axes, runs: Sequence[Course], scenario: Scenario, title: str) -> None:
    """Draw obstacles, paths and goals from above."""
    _draw_world(axes, scenario)
    for colour, course in zip(cycle(PALETTE), runs, strict=False):
        _draw_paths(axes, course, colour)
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title)
    axes.set_aspect("equal", adjustable="datalim")


def draw_legend(figure: Figure, *panels: Axes) -> None:
    """Draw the legend of some panels above all of them, where it covers nothing."""
    artists = (artist for axes in panels for artist in (*axes.lines, *axes.patches))
    lines = {str(artist.get_label()): artist for artist in artists}
    named = [name for name in lines if name and not name.startswith("_")]
    shown = {name: lines[name] for name in sorted(named, key="wanted".__eq__)}
    columns = min(len(shown), LEGEND_COLUMNS)
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=columns)


def _followed(course: Course) -> bool:
    return not np.isnan(course.table["target_x_m"]).all()


def _draw_world(axes: Axes, scenario: Scenario) -> None:
    for solid in scenario.world.solids:
        if isinstance(solid, Box):
            x, y = solid.size_m[0] / 2, solid.size_m[1] / 2
            box = Pose2D(*solid.position_m, math.radians(solid.yaw_deg))
            corners = (x, y), (-x, y), (-x, -y), (x, -y)
            outline = [box.compose(Pose2D(*corner))[:2] for corner in corners]
            axes.add_patch(Polygon(outline, **OBSTACLE))
        else:
            axes.add_patch(Circle(solid.position_m, solid.size_m[0], **OBSTACLE))


def _draw_paths(axes: Axes, course: Course, colour: str) -> None:
    """Draw the paths of a robot, its person and its goal from above."""
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
