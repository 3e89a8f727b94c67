"""The world and the marks in it: ground, obstacles, frames, arrows, ellipses and trails.

Shapes are logged once, below a moving frame: logging a frame costs a tenth of logging a shape.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder, Ridge
from mecazen.geometry import Pose2D
from mecazen.messages import planar_covariance
from mecazen.portable import Floats
from msgspec.structs import replace

from mecazen_viewer import layout, panels
from mecazen_viewer.layout import Colour, Entity

GRID_REACH_M = 20
GRID_STEP_M = 10
"""The grid moves with the robot in steps of this length, so that it appears endless."""
GRID_COLOUR = (170, 176, 185)
AXES_COLOUR = (110, 116, 126)
GRID_RADIUS = rr.Radius.ui_points(0.4)

TRAIL_COLOURS = {"robot": layout.BLUE, "odometry": layout.ORANGE, "person": layout.RED}
MARK_RADIUS = rr.Radius.ui_points(1.0)
MARK_Z = 0.004
"""Height of marks on the ground [m], just above the grid."""
ARROW_RADIUS = 0.025
GOAL_ARROW_M, ESTIMATE_ARROW_M, PERSON_ARROW_M = 0.3, 0.45, 0.6
PERSON_ARROW_Z = 0.42
"""Height of the person's arrow, as a share of the person's height."""
POINT_RADIUS = 0.012
OBSTACLE_COLOUR = (165, 140, 110)
ABOVE_M, ABOVE_WIDTH_M, ABOVE_PX = 100.0, 6.0, 600
"""Height of the camera above, and width of its picture in metres and in pixels."""
LABEL_Z = 0.35
"""Height of a robot's name [m]."""
LABEL_COLOUR = (25, 25, 25)
"""Colour of the text on grey, in both themes of the viewer."""
CIRCLE_POINTS = 49
CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)])
"""Corners of a rectangle of length and width 2."""
DOT_M = 1e-3

ELLIPSE_SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Scale of the 95 % ellipse: the chi-square quantile of two degrees of freedom is -2·ln(1 - p)."""
MIN_VARIANCE, MAX_VARIANCE = 1e-12, 1e6
"""Bounds of the eigenvalues [m², rad²] that can be drawn."""
MIN_RATIO = 1e-14
"""Minimum ratio of the eigenvalues: below it, rounding can make a covariance singular."""


def surroundings(scenario: Scenario) -> Iterator[Entity]:
    """Return the static entities that all robots share."""
    yield layout.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP
    solids = replace(scenario.world, added={}).solids
    # all boxes in one entity: a map has thousands
    if boxes := [solid for solid in solids if isinstance(solid, Box)]:
        yield f"{layout.OBSTACLES}/boxes", obstacles(boxes)
    if cylinders := [solid for solid in solids if isinstance(solid, Cylinder)]:
        yield f"{layout.OBSTACLES}/cylinders", obstacles(cylinders)
    for number, ridge in enumerate(scenario.world.ridges):
        yield f"{layout.RIDGES}/{number}", _ridge(ridge)
    for number, patch in enumerate(scenario.world.patches):
        place = Pose2D(*patch.position_m, math.radians(patch.yaw_deg))
        corners = [place.compose(Pose2D(*xy))[:2] for xy in CORNERS * patch.size_m / 2]
        yield f"{layout.PATCHES}/{number}", _outline(np.array(corners), layout.GREY)
    yield from panels.line_styles(panels.SHARED_PLOTS)


def styles() -> Iterator[Entity]:
    """Return the static styles of observations and trails, and the camera of the view from above.

    The camera's x points right, y up.
    """
    observation = rr.Points3D.from_fields(colors=[layout.ORANGE], radii=[POINT_RADIUS])
    yield layout.OBSERVATION, observation
    for name, colour in TRAIL_COLOURS.items():
        line = rr.LineStrips3D.from_fields(colors=[colour], radii=MARK_RADIUS)
        yield f"{layout.TRAILS}/{name}", line
    down = rr.Quaternion(xyzw=(1.0, 0.0, 0.0, 0.0))
    yield layout.ABOVE, rr.Transform3D(translation=(0.0, 0.0, ABOVE_M), quaternion=down)
    focal = ABOVE_PX / ABOVE_WIDTH_M * ABOVE_M
    yield layout.ABOVE, rr.Pinhole(focal_length=focal, width=ABOVE_PX, height=ABOVE_PX)


def marks(size: tuple[float, float], height: float) -> dict[str, dict[str, rr.AsComponents]]:
    """Return shapes by the frame that carries them and by their name.

    `size` is the robot's length and width [m], for its outline at the goal; `height` [m] of the
    person gives the height of the arrow that shows their heading.
    """
    angles = np.linspace(0.0, math.tau, CIRCLE_POINTS)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    z, radius = PERSON_ARROW_Z * height, 2.0 * ARROW_RADIUS
    return {
        layout.PERSON: {"arrow": _arrow(PERSON_ARROW_M, layout.RED, z, radius)},
        layout.GOAL: {
            "arrow": _arrow(GOAL_ARROW_M, layout.GREEN),
            "outline": _outline(CORNERS * size / 2.0, layout.GREEN),
        },
        layout.ESTIMATE: {"arrow": _arrow(ESTIMATE_ARROW_M, layout.PURPLE)},
        layout.ESTIMATE_ELLIPSE: {"outline": _outline(circle, layout.PURPLE)},
        layout.OBSERVATION_ELLIPSE: {"outline": _outline(circle, layout.ORANGE)},
    }


def label(robot: str) -> Entity:
    """Return the name of one of several robots, drawn above the robot."""
    position = [(0.0, 0.0, LABEL_Z)]
    point = rr.Points3D(position, labels=[robot], colors=[LABEL_COLOUR], radii=[DOT_M])
    return f"{layout.ROBOT}/label", point


def planar_frame(pose: Pose2D) -> rr.Transform3D:
    """Return a frame at a planar pose."""
    turn = (0.0, 0.0, math.sin(pose.yaw / 2.0), math.cos(pose.yaw / 2.0))
    return frame(np.array((pose.x, pose.y, 0.0)), np.array(turn))


def frame(position: Floats, turn: Floats) -> rr.Transform3D:
    """Return a frame at a position (3,) [m], turned by a quaternion (4,) as x, y, z, w."""
    return rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=turn))


def trail(points: Floats) -> rr.LineStrips3D:
    """Return a trail through points (N, 2) [m]."""
    return rr.LineStrips3D([_on_ground(points)])


def points(positions: Floats) -> rr.Points3D:
    """Return points on the ground at positions (N, 2) [m]."""
    return rr.Points3D(_on_ground(positions))


def ellipse(x: float, y: float, covariance: Floats | None, yaw: float = 0.0) -> rr.Transform3D:
    """Return the frame in which the unit circle is the 95 % ellipse at (x, y) [m].

    `covariance` (3, 3) over (x, y, yaw) is rotated by `yaw` [rad]; None is drawn as a dot.
    """
    axes = np.diag([DOT_M, DOT_M, 1.0])
    if covariance is not None:
        # any L with L·Lᵀ = C maps the unit circle to the same ellipse
        c, s = ELLIPSE_SCALE * math.cos(yaw), ELLIPSE_SCALE * math.sin(yaw)
        axes[:2, :2] = np.array(((c, -s), (s, c))) @ np.linalg.cholesky(covariance[:2, :2])
    return rr.Transform3D(translation=(x, y, 0.0), mat3x3=axes)


def drawable_covariance(covariance: tuple[float, ...]) -> Floats | None:
    """Return the covariance (3, 3) of (x, y, yaw) from ROS's 6x6; None if not positive definite."""
    rows = np.array(planar_covariance(covariance))
    symmetric: Floats = (rows + rows.T) / 2.0
    eigenvalues = np.linalg.eigvalsh(symmetric)
    smallest = max(MIN_VARIANCE, MIN_RATIO * eigenvalues[-1])
    if np.abs(symmetric).max() > MAX_VARIANCE or eigenvalues[0] < smallest:
        return None
    return symmetric


def grid_centre(pose: Pose2D) -> tuple[int, int]:
    """Return the centre of the grid [m] for a robot at `pose`."""
    x, y = (round(coordinate / GRID_STEP_M) * GRID_STEP_M for coordinate in pose[:2])
    return x, y


def ground(centre: tuple[int, int]) -> rr.LineStrips3D:
    """Return grid lines 1 m apart around `centre` [m]; the lines through the origin are darker."""
    steps = np.arange(-GRID_REACH_M, GRID_REACH_M + 1)
    # in short pieces, since Rerun draws long lines near the camera with a wrong width
    along, across = np.meshgrid(steps, steps)
    flat = np.zeros_like(along)
    x, y = centre
    both = (x + across, y + along, flat), (x + along, y + across, flat)
    strips = np.concatenate([np.stack(lines, axis=-1) for lines in both])
    through_origin = np.concatenate([steps + x, steps + y]) == 0
    colours = np.where(through_origin[:, np.newaxis], AXES_COLOUR, GRID_COLOUR).astype(np.uint8)
    return rr.LineStrips3D(strips, colors=colours, radii=GRID_RADIUS)


def obstacles(solids: Sequence[Box | Cylinder]) -> rr.AsComponents:
    """Return the shapes of obstacles of one kind."""
    style: dict[str, Any] = {"colors": [OBSTACLE_COLOUR], "fill_mode": "solid"}
    style["centers"] = [
        (*solid.position_m, solid.bottom_m + solid.size_m[-1] / 2) for solid in solids
    ]
    sizes = np.array([solid.size_m for solid in solids])
    yaws = [math.radians(solid.yaw_deg) for solid in solids if isinstance(solid, Box)]
    if not yaws:
        return rr.Cylinders3D(radii=sizes[:, 0], lengths=sizes[:, 1], **style)
    turns = [rr.RotationAxisAngle(axis=(0.0, 0.0, 1.0), radians=yaw) for yaw in yaws]
    return rr.Boxes3D(sizes=sizes, rotation_axis_angles=turns, **style)


def _ridge(ridge: Ridge) -> rr.Mesh3D:
    """Return a ramp or a sill."""
    foot, edge, side = ridge.top / 2 + ridge.run, ridge.top / 2, ridge.width / 2
    section = (-foot, 0.0), (-edge, ridge.rise), (edge, ridge.rise), (foot, 0.0)
    corners = [
        (*ridge.middle.compose(Pose2D(x, y))[:2], z) for y in (side, -side) for x, z in section
    ]
    faces = [(0, 4, 5), (0, 5, 1), (1, 5, 6), (1, 6, 2), (2, 6, 7), (2, 7, 3)]
    ends = [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)]
    colour = [*OBSTACLE_COLOUR, 255]
    return rr.Mesh3D(
        vertex_positions=corners, triangle_indices=[*faces, *ends], albedo_factor=colour
    )


def _arrow(
    length: float, colour: Colour, z: float = ARROW_RADIUS, radius: float = ARROW_RADIUS
) -> rr.Arrows3D:
    vectors, origins = [(length, 0.0, 0.0)], [(0.0, 0.0, z)]
    return rr.Arrows3D(vectors=vectors, origins=origins, radii=[radius], colors=[colour])


def _outline(corners: Floats, colour: Colour) -> rr.LineStrips3D:
    return rr.LineStrips3D([_on_ground(corners)], colors=[colour], radii=MARK_RADIUS)


def _on_ground(positions: Floats) -> npt.NDArray[np.float32]:
    """Return positions (N, 2) as (N, 3) [m], at the height of marks."""
    raised = np.full((len(positions), 3), MARK_Z, dtype=np.float32)
    raised[:, :2] = positions
    return raised
