"""One run as a figure: seen from above, and its errors and velocities over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from mecazen.config import Scenario
from mecazen.config.world import Box
from mecazen.geometry import Pose2D
from mecazen.robots import join_key

from mecazen_tools.drawing import COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE, draw_arrows
from mecazen_tools.trajectory import POSE, TWIST, Trajectory

Floats: TypeAlias = npt.NDArray[np.float64]

ARROWS = 12
"""Number of arrows along the path of each robot."""
WANTED: dict[str, Any] = {"color": "black", "ls": DASHES, "lw": 0.7, "zorder": 3.0}
WANTED["label"] = "wanted"
OBSTACLE: dict[str, Any] = {"facecolor": "#cccccc", "edgecolor": "#888888", "linewidth": 0.3}
ERRORS = {"distance\nerror [m]": 0.05, "heading\nerror [°]": 2.0}
VELOCITIES = {"vx [m/s]": 0.1, "vy [m/s]": 0.1, "wz [rad/s]": 0.1}
"""The panels over time with the minimum range of their axes: rounding must not look like motion."""


class Course(NamedTuple):
    """Motion and commands of a robot and its person: arrays with a row for each sample."""

    name: str
    """Name of the robot; empty if there is only one."""
    robot: Floats
    """(n, 7): t [s], true x [m], y [m] and yaw [rad] in world, vx, vy [m/s], wz [rad/s] in
    base_link."""
    person: Floats
    """(n, 7): the same of the person, with the velocity in their own frame; (0, 7) without one."""
    command: Floats
    """(n, 4): t, vx, vy, wz of `cmd_vel`, in base_link."""


def courses(trajectory: Trajectory) -> list[Course]:
    """Return the courses of the robots of a lockstep run."""
    table = trajectory.to_numpy()

    def rows(robot: str, prefix: str, names: Sequence[str]) -> Floats:
        columns = ("t_s", *(join_key(f"{prefix}_{name}", robot) for name in names))
        values: Floats = np.column_stack([table[column] for column in columns])
        return values[~np.isnan(values).any(axis=1)]

    motion = (*POSE, *TWIST)
    return [
        Course(
            name,
            rows(name, "robot", motion),
            rows(name, "target", motion),
            rows(name, "cmd", TWIST),
        )
        for name in trajectory.scenario.names
    ]


def draw(runs: Sequence[Course], scenario: Scenario, title: str) -> Figure:
    """Return the figure of the courses of a run, with goals as dashed and motion as solid lines.

    Goals and errors are drawn if a follower takes part. As in the scores, they use the settings of
    the scenario, without later changes of parameters.
    """
    follows = "follower" in scenario.services and any(len(course.person) for course in runs)
    names = {**(ERRORS if follows else {}), **VELOCITIES}
    with style.context(STYLE):
        figure = Figure(figsize=(2.4 * COLUMN_IN, 1.4 * COLUMN_IN), layout="constrained")
        grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
        above = figure.add_subplot(grid[0])
        panels = list(grid[1].subgridspec(len(names), 1).subplots(sharex=True, squeeze=False)[:, 0])
        _draw_world(above, scenario)
        for colour, course in zip(cycle(PALETTE), runs, strict=False):
            _draw_paths(above, course, colour)
            if follows:
                _draw_goal(above, panels, course, scenario.of(course.name), colour)
            for column, axes in enumerate(panels[-3:], 1):
                axes.plot(course.robot[:, 0], course.robot[:, 3 + column], color=colour, lw=1.0)
                # a command holds until the next one
                command = course.command[:, 0], course.command[:, column]
                axes.step(*command, where="post", **WANTED | {"lw": 0.4})
        above.set(xlabel="x [m]", ylabel="y [m]", title=title)
        above.set_aspect("equal", adjustable="datalim")
        for axes, (name, least) in zip(panels, names.items(), strict=True):
            low, high = axes.get_ylim()
            axes.set(ylabel=name, ylim=(min(low, -least), max(high, least)))
        panels[-1].set_xlabel("t [s]")
        figure.align_ylabels(panels)
        lines = {str(line.get_label()): line for line in (*above.lines, *panels[-1].lines)}
        shown = {name: lines[name] for name in sorted(lines, key="wanted".__eq__) if name[0] != "_"}
        figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=len(shown))
    return figure


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
    """Draw the paths of a robot and its person from above."""
    robot, person = course.robot, course.person
    if len(person):
        lighter = {"color": colour, "alpha": 0.45} if course.name else {"color": ORANGE}
        axes.plot(*person[:, 1:3].T, label=join_key("person", course.name), lw=0.7, **lighter)
        axes.plot(*person[0, 1:3], "o", markersize=2.5, **lighter)
    axes.plot(*robot[:, 1:3].T, color=colour, label=course.name or "robot", lw=0.7)
    size = max(float(np.ptp(np.vstack([robot, person])[:, 1:3], axis=0).max()), 1.0)
    poses = robot[:: max(1, len(robot) // ARROWS), 1:4]
    draw_arrows(axes, tuple(poses.T), colour, 0.05 * size, 0.006 * size)


def _draw_goal(
    above: Axes, panels: Sequence[Axes], course: Course, scenario: Scenario, colour: str
) -> None:
    """Draw the path of the goal, and the signed errors, whose mean magnitudes are the scores."""
    standoff, person = scenario.follower.standoff, course.person
    bearing = person[:, 3] + standoff.bearing
    offset = standoff.distance * np.stack([np.cos(bearing), np.sin(bearing)])
    if len(person):
        above.plot(*(person[:, 1:3].T + offset), **WANTED)
    t, robots, persons = np.intersect1d(course.robot[:, 0], person[:, 0], return_indices=True)
    difference = course.robot[robots, 1:4] - person[persons, 1:4]
    distance = np.hypot(*difference[:, :2].T) - standoff.distance
    heading = np.degrees((difference[:, 2] - standoff.heading + math.pi) % math.tau - math.pi)
    for axes, error in zip(panels, (distance, heading), strict=False):
        axes.plot(t, error, color=colour, lw=0.7)
        axes.axhline(0.0, **WANTED)
