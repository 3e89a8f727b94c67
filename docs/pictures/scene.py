"""Draws a moment of a run on a stage: world, robot, people, and sensor data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product

import numpy as np
from mecazen.config import Scenario
from mecazen.config.world import Cylinder, WorldConfig
from mecazen.geometry import Pose2D

from docs.pictures import oblique
from docs.pictures.oblique import Array, Camera, Draw, Stage, at, beams
from docs.pictures.runs import FOLLOWED, Moment, joints

CUT_M = 0.3
"""Height at which walls are cut off, so that they hide nothing."""
SHADOW_M = 0.22
PIECE_M = 0.5
TRAIL, PILLAR, PILLAR_TOP = "#c9a95a", "#b9b1a6", "#d9d3ca"
GUARD = {
    "clear": oblique.GREEN,
    "slow": oblique.ORANGE,
    "stop": oblique.RED,
    "blind": oblique.INK,
}
"""Colours of the guard's states."""


def from_above(x: float, y: float, size: tuple[int, int], width_m: float) -> Stage:
    """Return a stage with a steep view from above, about as wide as `width_m`."""
    eye, view_deg = np.array((0.0, -0.55, 1.0)) * 1.2 * width_m, 40.0
    return Stage(Camera(eye + (x, y, 0.0), (x, y, 0.0), size, view_deg))  # noqa: RUF005  # arrays


def draw(
    stage: Stage,
    scenario: Scenario,
    moment: Moment,
    middle: Sequence[float],
    way: Sequence[Pose2D] = (),
) -> None:
    """Draw a moment, with a grid round the middle (2,) [m], and the robot's past path."""
    robot = scenario.robot
    assert robot.lidar is not None
    hits, ends = beams(moment.latest["scan"], robot.lidar.position_m, moment.robot)
    stage.seen(ends)
    stage.ground(middle)
    if way:
        x, y, _ = np.array(way).T
        stage.line(np.column_stack((x, y, 0.0 * x)), TRAIL, 1.5)
    shadows(stage, [*moment.people.values()], [moment.robot])
    for goal in moment.follower.goal:
        stage.outline(goal.to_planar(), robot.footprint, oblique.GREEN, 1.6)
    things = [*solids(stage, scenario.world), *bodies(stage, moment.people, (FOLLOWED,))]
    turned = moment.latest["joint_states"].position[:4]
    place = at(moment.robot, 0.0, 0.0, 0.1)
    things.append((place, partial(stage.robot, robot, moment.robot, turned)))
    stage.far_to_near(things)
    stage.dots(hits, oblique.BLUE, 5.0)


def bones(stage: Stage, moment: Moment) -> None:
    """Draw the bodies that the tracker reports."""
    for seen in moment.bones:
        x, y, z = joints(seen.joints).T
        known = seen.confidence or (2,) * len(x)
        stage.bones(at(moment.bones_from, x, y, z), [sure > 0 for sure in known])


def shadows(stage: Stage, people: Sequence[Array], robots: Sequence[Pose2D]) -> None:
    """Draw the shadows of people and robots."""
    for x, y in (*(body[0, :2].tolist() for body in people), *(pose[:2] for pose in robots)):
        stage.disc(x, y, SHADOW_M, oblique.SHADE, alpha=0.6)


def bodies(
    stage: Stage, people: dict[str, Array], followed: Sequence[str]
) -> list[tuple[Array, Draw]]:
    """Return the people, to be drawn from far to near."""
    return [
        (
            body,
            partial(
                stage.body,
                body,
                oblique.FOLLOWED_LOOK if name in followed else oblique.OTHER_LOOK,
            ),
        )
        for name, body in people.items()
    ]


def solids(stage: Stage, world: WorldConfig, cut_m: float = CUT_M) -> list[tuple[Array, Draw]]:
    """Return the obstacles of a world, cut off at a height, to be drawn from far to near."""
    things: list[tuple[Array, Draw]] = []
    for solid in world.solids:
        high = min(solid.size_m[-1], cut_m)
        if isinstance(solid, Cylinder):
            pose = Pose2D(*solid.position_m)
            pillar = partial(stage.pillar, pose, solid.size_m[0], 0.0, high, PILLAR, PILLAR_TOP)
            things.append((at(pose, 0.0, 0.0, 0.0), pillar))
        elif solid.bottom_m < cut_m:
            pose = Pose2D(*solid.position_m, math.radians(solid.yaw_deg))
            for piece, length, width in _pieces(pose, *solid.size_m[:2]):
                size = length, width, high
                box = partial(stage.box, piece, size, solid.bottom_m, oblique.WALL, linewidth=0.0)
                things.append((at(piece, 0.0, 0.0, 0.0), box))
    return things


def _pieces(pose: Pose2D, length: float, width: float) -> Iterator[tuple[Pose2D, float, float]]:
    """Yield short pieces of a rectangle: a long wall is in front of one object, behind another."""
    n, m = max(1, round(length / PIECE_M)), max(1, round(width / PIECE_M))
    for i, j in product(range(n), range(m)):
        x, y = length * ((i + 0.5) / n - 0.5), width * ((j + 0.5) / m - 0.5)
        yield pose.compose(Pose2D(x, y)), length / n, width / m


def badge(stage: Stage, moment: Moment) -> None:
    """Write the guard's state and the time into the corners."""
    state = str(moment.latest["guard/state"].state)
    height = stage.camera.size[1]
    text = f"{moment.time_s:.1f} s"
    stage.axes.text(12, height - 18, text, color=oblique.INK, fontsize=9, va="center", zorder=9_999)
    look = {"boxstyle": "round,pad=0.35", "facecolor": GUARD[state], "edgecolor": "none"}
    stage.axes.text(
        stage.camera.size[0] - 12,
        height - 18,
        f"guard: {state}",
        color="white",
        fontsize=9,
        va="center",
        ha="right",
        bbox=look,
        zorder=9_999,
    )
