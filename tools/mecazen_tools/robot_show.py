"""A robot file, drawn with its dimensions, and driven to compare its gains with the formulas."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from mecazen.geometry import Twist2D
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import lateral_gain, yaw_gain

from mecazen_tools.drawing import BLUE, COLUMN_IN, ORANGE, STYLE
from mecazen_tools.simulation import Simulation

START_S = 2.0
"""Time in which the robot reaches its speed."""
ARCS = 20
"""Number of rollers of a wheel that pass the ground in a check."""
TOP_SPEED = 0.25
"""Speed of the wheels in a check, as a share of their highest."""


def gains(robot: Robot, file: Path) -> Iterator[tuple[str, float, float]]:
    """Drive a robot forward, to the left, on the spot and diagonally in physics.

    A check lasts as long as whole rollers pass the ground, as gains vary within each. In the
    diagonal check two wheels stand, so cos θ of `lateral_gain` is that of the others only: the gain
    is the mean of 2 cos θ/(1 + cos θ) over |θ| ≤ α = π/N, 2 - 2 tan(α/2)/α.

    Yields:
        The check, and the robot's speed over the commanded speed, measured and by the formula.
    """
    arc = math.pi / robot.rollers.count
    rim, cross = TOP_SPEED * robot.wheels.max_speed_rad_s * robot.wheels.radius_m, robot.cross_gain
    rim = min(rim, 0.5, abs(cross) * 0.5, abs(robot.lever) * 0.8)
    yaw, (ahead, left) = rim / robot.lever, robot.wheels.centre_m
    diagonal = 2.0 - 2.0 * math.tan(arc / 2) / arc
    checks = {
        "forward": (Twist2D(rim), 1.0),
        "left": (Twist2D(0.0, rim / cross), lateral_gain(robot.rollers.count)),
        "turn": (Twist2D(left * yaw, -ahead * yaw, yaw), yaw_gain(robot)),  # about their centre
        "diagonal": (Twist2D(rim / 2, rim / cross / 2), diagonal),
    }
    settings = {"robot": file, "services": ["physics", "controller"], "sensor.also": []}
    for check, (command, formula) in checks.items():
        with Simulation("teleop", settings, duration_s=60.0) as simulation:
            tick_s = simulation.scenario.sim.tick_s
            ticks = math.ceil(2.0 * arc * robot.wheels.radius_m / rim / tick_s)
            share = 2.0 * arc * robot.wheels.radius_m / (ticks * tick_s) / rim
            twist = Twist2D(*(share * part for part in command))
            simulation.command(twist.x, twist.y, twist.yaw)
            start = before = simulation.run(START_S).robot
            turned = 0.0
            for _ in range(ARCS):
                pose = simulation.run(ticks * tick_s).robot
                turned += math.remainder(pose.yaw - before.yaw, math.tau)
                before = pose
        seconds = ARCS * ticks * tick_s
        if check == "turn":
            yield check, turned / (twist.yaw * seconds), formula
        else:
            moved = start.between(before)
            along = moved.x * twist.x + moved.y * twist.y
            yield check, along / (math.hypot(twist.x, twist.y) ** 2 * seconds), formula


def draw(robot: Robot) -> Figure:
    """Return a figure of a robot from above and from the side, with its dimensions [mm]."""
    base, wheels, (half_length, half_width) = robot.base, robot.wheels, robot.footprint
    radius, width = wheels.radius_m, wheels.hub_width_m
    with style.context(STYLE):
        figure = Figure(figsize=(2.2 * COLUMN_IN, 1.1 * COLUMN_IN), layout="constrained")
        above, side = figure.subplots(1, 2)
        ahead, left = wheels.centre_m
        _box(above, (ahead, left), (base.length_m, base.width_m), BLUE)
        middle = base.clearance_m + base.height_m / 2
        _box(side, (ahead, middle), (base.length_m, base.height_m), BLUE)
        above.plot(0.0, 0.0, "k+")  # base_link
        for wheel, number in zip(WHEELS, wheels.mounting, strict=True):
            x, y, z = robot.wheel_position(wheel)
            _box(above, (x, y), (2 * radius, width), "#555555")
            side.add_patch(Circle((x, z), radius, facecolor="#555555", alpha=0.7))
            # the rollers on top
            gain = robot.cross_gain if number in {1, 4} else -robot.cross_gain
            slope = math.copysign(math.tan(robot.roller_angle), gain)
            for roller in (-0.6 * radius, 0.0, 0.6 * radius):
                ends = [x + roller + slope * end for end in (-width / 2, width / 2)]
                above.plot(ends, [y - width / 2, y + width / 2], color="white", lw=0.8)
        for part in (robot.camera, robot.lidar):
            if part is not None:
                x, y, z = part.position_m
                length, across = (
                    (2 * part.size_m[0],) * 2 if part is robot.lidar else part.size_m[:2]
                )
                _box(above, (x, y), (length, across), ORANGE)
                _box(side, (x, z), (length, part.size_m[-1]), ORANGE)
        gap = 0.15 * half_length
        below, behind = -half_width - gap, -half_length - gap
        axle, track, half = robot.half_wheelbase, robot.half_track, base.length_m / 2
        _dimension(above, (ahead - axle, below), (ahead + axle, below))
        _dimension(above, (behind, left - track), (behind, left + track))
        _dimension(above, (ahead - half, -below), (ahead + half, -below))
        _dimension(side, (behind, 0.0), (behind, robot.height))
        _dimension(side, (ahead + axle - radius, -gap), (ahead + axle + radius, -gap))
        _dimension(side, (ahead, 0.0), (ahead, base.clearance_m))
        side.axhline(0.0, color="black", lw=0.6)
        above.set(title=f"{robot.name}, from above [mm]", xlabel="x [m]", ylabel="y [m]")
        side.set(title="from the right [mm]", xlabel="x [m]", ylabel="z [m]")
        for axes in (above, side):
            axes.set_aspect("equal", adjustable="datalim")
            axes.margins(0.1)
            axes.autoscale_view()
    return figure


def _box(axes: Axes, centre: tuple[float, float], size: tuple[float, float], colour: str) -> None:
    corner = centre[0] - size[0] / 2, centre[1] - size[1] / 2
    axes.add_patch(Rectangle(corner, *size, facecolor=colour, alpha=0.7))


def _dimension(axes: Axes, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw the distance between two points as an arrow with its length."""
    axes.update_datalim([begin, end])
    axes.annotate("", begin, end, arrowprops={"arrowstyle": "<->", "lw": 0.5})
    middle = (begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2
    axes.text(
        *middle,
        f"{1000 * math.dist(begin, end):.0f}",
        rotation=90 if begin[0] == end[0] else 0,
        ha="center",
        va="center",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )
