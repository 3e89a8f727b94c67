"""Entities of the scene apart from the robot.

Shapes are logged once, below a moving frame: logging a frame costs a tenth of logging a shape.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
from mecazen.config.world import Ridge
from mecazen.geometry import Pose2D

from mecazen_viewer import components
from mecazen_viewer import entities as e
from mecazen_viewer.entities import Colour, Entity

Array = npt.NDArray[np.float64]

GRID_REACH_M = 20
GRID_STEP_M = 10
"""The grid moves with the robot in steps of this length, so that it appears endless."""
GRID_COLOUR = (170, 176, 185)
AXES_COLOUR = (110, 116, 126)
GRID_RADIUS = rr.Radius.ui_points(0.4)

TRAIL_COLOURS = {"robot": e.BLUE, "odometry": e.ORANGE, "person": e.RED}
TRAIL_RADIUS = rr.Radius.ui_points(1.0)
MARK_RADIUS = rr.Radius.ui_points(1.0)
MARK_Z = 0.004
"""Height of marks on the ground [m], just above the grid."""
ARROW_RADIUS = 0.025
GOAL_ARROW_M, ESTIMATE_ARROW_M = 0.3, 0.45
POINT_RADIUS = 0.012

OBSTACLE_COLOUR = (165, 140, 110)
LABEL_Z = 0.35
"""Height of a robot's name [m]."""
LABEL_COLOUR = (25, 25, 25)
"""Colour of the text on grey, in both themes of the viewer."""
CIRCLE_POINTS = 49
OUTLINE = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
"""Corners of a rectangle of length and width 2."""
DOT_M = 1e-3

ARROW = 0.42
"""Height of the person's arrow, as a share of the person's height."""
PERSON_ARROW_M = 0.6


def frame(path: str, pose: Pose2D) -> Entity:
    """Return a planar frame."""
    turn = (0.0, 0.0, math.sin(pose.yaw / 2.0), math.cos(pose.yaw / 2.0))
    return path, components.transform(np.array([pose.x, pose.y, 0.0]), np.array(turn))


def grid_centre(pose: Pose2D) -> tuple[int, int]:
    """Return the centre of the grid [m] for a robot at `pose`."""
    x, y = (round(place / GRID_STEP_M) * GRID_STEP_M for place in pose[:2])
    return x, y


def ground(centre: tuple[int, int]) -> Entity:
    """Return grid lines 1 m apart around `centre` [m]; the lines through the origin are darker."""
    places = np.arange(-GRID_REACH_M, GRID_REACH_M + 1)
    # in short pieces, since Rerun draws long lines near the camera with a wrong width
    along, across = np.meshgrid(places, places)
    flat = np.zeros_like(along)
    x, y = centre
    both = (x + across, y + along, flat), (x + along, y + across, flat)
    strips = np.concatenate([np.stack(lines, axis=-1) for lines in both])
    through_origin = np.concatenate([places + x, places + y]) == 0
    colours = np.where(through_origin[:, np.newaxis], AXES_COLOUR, GRID_COLOUR).astype(np.uint8)
    return e.GROUND, rr.LineStrips3D(strips, colors=colours, radii=GRID_RADIUS)


def obstacle(number: int, size: Sequence[float], place: Pose2D, bottom: float = 0.0) -> Entity:
    """Return an obstacle, whose underside is at the height `bottom` [m].

    `size` [m] is a box's length, width and height, or a cylinder's radius and height.
    """
    path = f"{e.OBSTACLES}/{number}"
    look: dict[str, Any] = {"colors": [OBSTACLE_COLOUR], "fill_mode": "solid"}
    look["centers"] = [(place.x, place.y, bottom + size[-1] / 2)]
    if len(size) == 2:
        return path, rr.Cylinders3D(radii=[size[0]], lengths=[size[1]], **look)
    turns = [rr.RotationAxisAngle(axis=(0.0, 0.0, 1.0), radians=place.yaw)]
    return path, rr.Boxes3D(sizes=[size], rotation_axis_angles=turns, **look)


def ridge(number: int, shape: Ridge) -> Entity:
    """Return a ramp or a sill."""
    foot, edge, side = shape.top / 2 + shape.run, shape.top / 2, shape.width / 2
    section = (-foot, 0.0), (-edge, shape.rise), (edge, shape.rise), (foot, 0.0)
    corners = []
    for y in (side, -side):
        for x, z in section:
            at = shape.middle.compose(Pose2D(x, y))
            corners.append((at.x, at.y, z))
    faces = [(0, 4, 5), (0, 5, 1), (1, 5, 6), (1, 6, 2), (2, 6, 7), (2, 7, 3)]
    ends = [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)]
    colour = [*OBSTACLE_COLOUR, 255]
    mesh = rr.Mesh3D(
        vertex_positions=corners, triangle_indices=[*faces, *ends], albedo_factor=colour
    )
    return f"{e.RIDGES}/{number}", mesh


def patch(number: int, size: Sequence[float], place: Pose2D) -> Entity:
    """Return the outline of a patch of the ground of `size` (length, width) [m]."""
    corners = [(i * size[0] / 2, j * size[1] / 2) for i, j in OUTLINE]
    places = [place.compose(Pose2D(*corner)) for corner in corners]
    line = [(at.x, at.y, MARK_Z) for at in places]
    return f"{e.PATCHES}/{number}", rr.LineStrips3D([line], colors=[e.GREY], radii=MARK_RADIUS)


def marks(length: float, width: float, height: float) -> dict[str, list[Entity]]:
    """Return the shapes below each frame; they are drawn once the frame is placed.

    `length` and `width` [m] of the robot give the outline at the goal. `height` [m] of the person
    gives the height of the arrow that shows their heading.
    """
    corners = np.array(OUTLINE) * (length / 2, width / 2)
    angles = np.linspace(0.0, math.tau, CIRCLE_POINTS)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    shapes: dict[str, dict[str, rr.AsComponents]] = {
        e.PERSON: {"arrow": _arrow(PERSON_ARROW_M, e.RED, ARROW * height, 2.0 * ARROW_RADIUS)},
        e.GOAL: {"arrow": _arrow(GOAL_ARROW_M, e.GREEN), "outline": _outline(corners, e.GREEN)},
        e.ESTIMATE: {"arrow": _arrow(ESTIMATE_ARROW_M, e.PURPLE)},
        e.ESTIMATE_ELLIPSE: {"outline": _outline(circle, e.PURPLE)},
        e.OBSERVATION_ELLIPSE: {"outline": _outline(circle, e.ORANGE)},
    }
    return {
        frame: [(f"{frame}/{name}", shape) for name, shape in below.items()]
        for frame, below in shapes.items()
    }


def styles() -> Iterator[Entity]:
    """Return the styles of trails and points."""
    yield e.OBSERVATION, rr.Points3D.from_fields(colors=[e.ORANGE], radii=[POINT_RADIUS])
    for name, colour in TRAIL_COLOURS.items():
        line = rr.LineStrips3D.from_fields(colors=[colour], radii=TRAIL_RADIUS)
        yield f"{e.TRAILS}/{name}", line


def label(robot: str) -> Entity:
    """Return the name of one of several robots, drawn above the robot."""
    place = [(0.0, 0.0, LABEL_Z)]
    point = rr.Points3D(place, labels=[robot], colors=[LABEL_COLOUR], radii=[DOT_M])
    return f"{e.ROBOT}/label", point


def trail(name: str, points: Array) -> Entity:
    """Return a trail through points (N, 2) [m]."""
    return f"{e.TRAILS}/{name}", components.line(_raised(points))


def points(places: Array) -> Entity:
    """Return observed positions (N, 2) [m] in world."""
    return e.OBSERVATION, components.points(_raised(places))


def ellipse(path: str, x: float, y: float, axes: Array | None) -> Entity:
    """Return an ellipse, the unit circle mapped by `axes` (2, 2) [m]; a dot for None."""
    stretch = np.diag([DOT_M, DOT_M, 1.0])
    if axes is not None:
        stretch[:2, :2] = axes
    return path, components.stretched(np.array([x, y, 0.0]), stretch)


def _arrow(
    length: float, colour: Colour, z: float = ARROW_RADIUS, radius: float = ARROW_RADIUS
) -> rr.Arrows3D:
    vectors, origins = [(length, 0.0, 0.0)], [(0.0, 0.0, z)]
    return rr.Arrows3D(vectors=vectors, origins=origins, radii=[radius], colors=[colour])


def _outline(places: Array, colour: Colour) -> rr.LineStrips3D:
    return rr.LineStrips3D([_raised(places)], colors=[colour], radii=MARK_RADIUS)


def _raised(places: Array) -> npt.NDArray[np.float32]:
    raised = np.full((len(places), 3), MARK_Z, dtype=np.float32)
    raised[:, :2] = places
    return raised
