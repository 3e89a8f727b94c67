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

from mecazen_tools.drawing import COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE
from mecazen_tools.trajectory import POSE, TWIST, Trajectory

Floats: TypeAlias = npt.NDArray[np.float64]

ARROWS = 12
"""Number of arrows along the path of each robot."""
WANTED: dict[str, Any] = {
    "color": "black",
    "linestyle": DASHES,
    "linewidth": 0.7,
    "zorder": 3.0,
    "label": "wanted",
}
ACTUAL: dict[str, Any] = {"linewidth": 0.7}
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


def courses(trajectory: Trajectory, scenario: Scenario) -> list[Course]:
    """Return the courses of the robots of a lockstep run."""
    table = trajectory.to_numpy()

    def rows(robot: str, *names: str) -> Floats:
        columns = ("t_s", *(join_key(name, robot) for name in names))
        found: Floats = np.column_stack([table[name] for name in columns])
        return found[~np.isnan(found).any(axis=1)]

    return [
        Course(
            name,
            rows(name, *(f"robot_{what}" for what in (*POSE, *TWIST))),
            rows(name, *(f"target_{what}" for what in (*POSE, *TWIST))),
            rows(name, *(f"cmd_{what}" for what in TWIST)),
        )
        for name in scenario.names
    ]


def draw(ways: Sequence[Course], scenario: Scenario, title: str) -> Figure:
    """Return the figure of a run, with goals as dashed and motion as solid lines.

    Goals and errors are drawn if a follower takes part. As in the scores, they use the settings of
    the scenario, without later changes of parameters.
    """
    follows = "follower" in scenario.services and any(len(way.person) for way in ways)
    names = {**(ERRORS if follows else {}), **VELOCITIES}
    with style.context(STYLE):
        figure = Figure(figsize=(2.4 * COLUMN_IN, 1.4 * COLUMN_IN), layout="constrained")
        grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
        above = figure.add_subplot(grid[0])
        panels = list(grid[1].subgridspec(len(names), 1).subplots(sharex=True, squeeze=False)[:, 0])
        _draw_world(above, scenario)
        for colour, way in zip(cycle(PALETTE), ways, strict=False):
            of = scenario.of(way.name)
            _draw_way(above, way, of, colour, follows=follows)
            if follows:
                _draw_errors(panels[0], panels[1], way, of, colour)
            _draw_velocities(panels[-3:], way, colour)
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


def draw_arrows(
    axes: Axes, poses: Sequence[Floats], colour: str, length: float, width: float
) -> None:
    """Draw poses (arrays of x [m], y [m] and yaw [rad]) as arrows of a length and a width [m]."""
    x, y, yaw = poses
    arrows = length * np.cos(yaw), length * np.sin(yaw)
    scale: dict[str, Any] = {"angles": "xy", "units": "xy", "scale": 1.0, "width": width}
    axes.quiver(x, y, *arrows, color=colour, zorder=4.0, **scale)


def _draw_world(axes: Axes, scenario: Scenario) -> None:
    """Draw the obstacles of the world from above."""
    grey: dict[str, Any] = {"facecolor": "#cccccc", "edgecolor": "#888888", "linewidth": 0.3}
    for solid in scenario.world.solids:
        if isinstance(solid, Box):
            half_x, half_y = solid.size_m[0] / 2, solid.size_m[1] / 2
            middle = Pose2D(*solid.position_m, math.radians(solid.yaw_deg))
            corners = ((1, 1), (-1, 1), (-1, -1), (1, -1))
            outline = [middle.compose(Pose2D(i * half_x, j * half_y))[:2] for i, j in corners]
            axes.add_patch(Polygon(outline, **grey))
        else:
            axes.add_patch(Circle(solid.position_m, solid.size_m[0], **grey))


def _draw_way(axes: Axes, way: Course, scenario: Scenario, colour: str, *, follows: bool) -> None:
    """Draw the paths of a robot and its person from above, and the path of the robot's goal."""
    robot, person = way.robot, way.person
    if len(person):
        lighter = {"color": colour, "alpha": 0.45} if way.name else {"color": ORANGE}
        axes.plot(*person[:, 1:3].T, label=join_key("person", way.name), **lighter, **ACTUAL)
        axes.plot(*person[0, 1:3], "o", markersize=2.5, **lighter)
    axes.plot(*robot[:, 1:3].T, color=colour, label=way.name or "robot", **ACTUAL)
    places = np.vstack([robot, person])[:, 1:3]
    size = max(float(np.ptp(places, axis=0).max()), 1.0)
    some = robot[:: max(1, len(robot) // ARROWS)]
    draw_arrows(axes, tuple(some[:, 1:4].T), colour, 0.05 * size, 0.006 * size)
    standoff = scenario.follower.standoff
    if follows and len(person):
        bearing = person[:, 3] + standoff.bearing
        x = person[:, 1] + standoff.distance * np.cos(bearing)
        y = person[:, 2] + standoff.distance * np.sin(bearing)
        axes.plot(x, y, **WANTED)


def _draw_errors(
    distance: Axes, heading: Axes, way: Course, scenario: Scenario, colour: str
) -> None:
    """Draw the signed errors; the scores are the means of their magnitudes."""
    wanted_m, _, wanted_rad = scenario.follower.standoff
    t, of_robot, of_person = np.intersect1d(way.robot[:, 0], way.person[:, 0], return_indices=True)
    robot, person = way.robot[of_robot], way.person[of_person]
    off = np.hypot(*(robot - person)[:, 1:3].T) - wanted_m
    turned = robot[:, 3] - person[:, 3] - wanted_rad
    degrees = np.degrees((turned + math.pi) % math.tau - math.pi)
    for axes, error in ((distance, off), (heading, degrees)):
        axes.plot(t, error, color=colour, **ACTUAL)
        axes.axhline(0.0, **WANTED)


def _draw_velocities(panels: Sequence[Axes], way: Course, colour: str) -> None:
    """Draw the robot's true velocity, and the commanded one."""
    for number, axes in enumerate(panels):
        axes.plot(way.robot[:, 0], way.robot[:, 4 + number], color=colour, linewidth=1.0)
        # a command holds until the next one
        command = way.command[:, 0], way.command[:, 1 + number]
        axes.step(*command, where="post", **{**WANTED, "linewidth": 0.4})
