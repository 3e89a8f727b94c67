"""Draws a run obliquely from above: ground, robot, people, and sensor data."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mecazen import messages as m
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot
from mecazen.skeleton import INDEX, LIMBS, PARENTS
from mecazen.urdf import COLOURS
from mecazen_viewer.senses import CLOTHES, FOLLOWED, LOOKS, OTHER
from PIL import Image

Array = npt.NDArray[np.float64]
Draw = Callable[[], None]

BLUE, ORANGE, GREEN, RED, INK = "#1f77b4", "#f07800", "#1b9e5a", "#c0392b", "#33404d"
PAPER, SEEN, GRID, SHADE = "#ffffff", "#e8f3fb", "#d5dde5", "#c3ccd6"
DARK, METAL, LIGHT_METAL = "#2b3138", "#46505a", "#aab4be"
YELLOW = tuple(map(float, COLOURS["base"].split()[:3]))
BLACK, WALL = (0.25, 0.29, 0.34), (0.90, 0.88, 0.85)
DPI = 100.0
PT = 72.0 / DPI
"""Points in a pixel."""

FOLLOWED_LOOK, OTHER_LOOK = (
    tuple(f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in look)
    for look in (FOLLOWED, OTHER)
)
"""Colours of clothes, trousers and skin, as in the viewer."""
_PART = {"upper_arm": CLOTHES, **LOOKS}
_BONES = [(INDEX[parent], INDEX[joint]) for joint, parent in PARENTS.items() if parent is not None]
_TRUNK = [INDEX[name] for name in ("left_shoulder", "right_shoulder", "right_hip", "left_hip")]
_TRUNK_M, _NECK_M = 0.11, 0.085
_LIGHT = np.array((-0.35, -0.5, 0.8))
_CORNERS = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1))) / 2.0
_FACES = (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)
_CIRCLE = np.linspace(0.0, math.tau, 33)


class Camera:
    """A perspective camera: projects points in world [m] to positions in a picture [px].

    Args:
        eye: Position of the camera [m].
        at: Point in the middle of the picture [m].
        size: Width and height of the picture [px].
        view_deg: Horizontal field of view.
    """

    def __init__(
        self, eye: npt.ArrayLike, at: npt.ArrayLike, size: tuple[int, int], view_deg: float
    ) -> None:
        self.eye, self.size = np.array(eye, float), size
        self._ahead = _unit(np.array(at, float) - self.eye)
        self._right = _unit(np.cross(self._ahead, (0.0, 0.0, 1.0)))
        self._up = np.cross(self._right, self._ahead)
        self._focal = size[0] / 2.0 / math.tan(math.radians(view_deg) / 2.0)

    def depth(self, points: Array) -> Array:
        """Return the distance of points (..., 3) along the line of sight [m]."""
        depths: Array = (points - self.eye) @ self._ahead
        return depths

    def project(self, points: Array) -> Array:
        """Return the projections (..., 2) [px] of points (..., 3); NaN behind the camera."""
        off, depth = points - self.eye, self.depth(points)
        depth = np.where(depth > 0.05, depth, np.nan)
        x = self.size[0] / 2.0 + self._focal * (off @ self._right) / depth
        y = self.size[1] / 2.0 + self._focal * (off @ self._up) / depth
        return np.stack((x, y), axis=-1)

    def scale(self, point: Array) -> float:
        """Return the length of a metre at a point [px]."""
        return float(self._focal / self.depth(point))


class Stage:
    """A picture under construction: each object is drawn over the previous ones."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        width, height = camera.size
        size = width / DPI, height / DPI
        self.figure = Figure(figsize=size, dpi=DPI, facecolor=PAPER)
        FigureCanvasAgg(self.figure)
        self.axes: Axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set(xlim=(0, width), ylim=(0, height))
        self.axes.axis("off")
        self._order = 0

    def picture(self) -> Image.Image:
        """Return the finished picture."""
        file = io.BytesIO()
        self.figure.savefig(file, format="png", dpi=DPI)
        return Image.open(file).convert("RGB")

    def legend(self, entries: Iterable[tuple[str, str]]) -> None:
        """Write the meaning of colours, in a row at the bottom."""
        x, y, top = 16.0, 13.0, 10_000
        self.axes.axhspan(0.0, 2.0 * y, color=PAPER, zorder=top)
        for text, color in entries:
            self.axes.plot(x, y, "o", color=color, markersize=5, markeredgewidth=0, zorder=top)
            label = self.axes.text(x + 9, y, text, color=INK, fontsize=8, zorder=top)
            label.set_verticalalignment("center_baseline")
            x = label.get_window_extent().x1 + 20.0

    def fill(self, points: Array, color: Any, **look: Any) -> None:
        """Fill a polygon (n, 3), unless a corner is behind the camera."""
        xy = self.camera.project(points)
        if np.isfinite(xy).all():
            look = {"linewidth": 0.0, "zorder": self.next(), **look}
            self.axes.fill(xy[:, 0], xy[:, 1], color=color, **look)

    def line(self, points: Array, color: Any, width_px: float, **look: Any) -> None:
        """Draw a line through points (n, 3)."""
        xy = self.camera.project(points)
        look = {"solid_capstyle": "round", "solid_joinstyle": "round", **look}
        look |= {"linewidth": PT * width_px, "zorder": self.next()}
        self.axes.plot(xy[:, 0], xy[:, 1], color=color, **look)

    def dots(self, points: Array, color: Any, size_px: float) -> None:
        """Draw points (n, 3)."""
        xy = self.camera.project(points)
        look: dict[str, Any] = {"markersize": PT * size_px, "markeredgewidth": 0}
        self.axes.plot(xy[:, 0], xy[:, 1], ".", color=color, zorder=self.next(), **look)

    def next(self) -> int:
        """Return the next layer, above all objects so far."""
        self._order += 1
        return self._order

    def ground(self, middle: Sequence[float], reach: int = 14) -> None:
        """Draw a grid of lines 1 m apart."""
        x, y = round(middle[0]), round(middle[1])
        along = np.linspace(-reach, reach, 8 * reach)
        for k in range(-reach, reach + 1):
            across = np.full_like(along, k)
            self.line(np.column_stack((x + along, y + across, 0.0 * along)), GRID, 0.8)
            self.line(np.column_stack((x + across, y + along, 0.0 * along)), GRID, 0.8)

    def disc(self, x: float, y: float, radius: float, color: Any, **look: Any) -> None:
        """Fill a circle on the ground."""
        self.fill(_ring(Pose2D(x, y), radius, 0.0), color, **look)

    def seen(self, ends: Array) -> None:
        """Fill the area that a lidar scans, up to the ends of its beams on the ground (n, 3)."""
        self.fill(ends[self.camera.depth(ends) > 0.3], SEEN)

    def body(self, joints: Array, look: Sequence[str], height: float = 1.75) -> None:
        """Draw a person with joints (20, 3) [m]."""
        parts: list[tuple[Array, Draw]] = [(joints[_TRUNK], partial(self._trunk, joints, look))]
        for limb in LIMBS:
            kind = next((part for name, part in _PART.items() if limb.name.endswith(name)), None)
            if kind is not None:
                ends = joints[[INDEX[limb.begin], INDEX[limb.end]]]
                ends[1, 2] += 1e-3  # a sphere is drawn as a line of almost no length
                width = 2.0 * limb.radius * height * self.camera.scale(ends.mean(axis=0))
                parts.append((ends, partial(self.line, ends, look[kind], width)))
        self.far_to_near(parts)

    def _trunk(self, joints: Array, look: Sequence[str]) -> None:
        corners = joints[_TRUNK]
        middle = corners.mean(axis=0)
        scale = self.camera.scale(middle)
        inner = middle + 0.8 * (corners - middle)
        self.line(joints[[INDEX["neck"], INDEX["head"]]], look[2], _NECK_M * scale)
        self.line(np.vstack((inner, inner[:2])), look[0], _TRUNK_M * scale)
        self.fill(inner, look[0])

    def bones(self, joints: Array, known: Sequence[bool]) -> None:
        """Draw the bones between known joints (20, 3) [m]."""
        width = max(0.022 * self.camera.scale(joints.mean(axis=0)), 1.4)
        for a, b in _BONES:
            if known[a] and known[b]:
                self.line(joints[[a, b]], ORANGE, width)
        self.dots(joints[np.array(known, bool)], ORANGE, max(2.6 * width, 4.0))

    def box(
        self,
        pose: Pose2D,
        size: Sequence[float],
        bottom: float,
        color: Sequence[float],
        **look: Any,
    ) -> None:
        """Draw a box centred at a pose, with shaded faces."""
        xy = np.tile(_CORNERS * size[:2], (2, 1))
        z = bottom + np.repeat((0.0, size[2]), 4)
        points = at(pose, xy[:, 0], xy[:, 1], z)
        for face in _FACES:
            polygon = points[list(face)]
            normal = _unit(polygon.mean(axis=0) - points.mean(axis=0))
            if (self.camera.eye - polygon[0]) @ normal > 0.0:
                shade = 0.72 + 0.28 * max(0.0, float(normal @ _LIGHT))
                edge = [0.6 * part for part in color]
                paint = [shade * part for part in color]
                self.fill(polygon, paint, **{"edgecolor": edge, "linewidth": 0.5, **look})

    def pillar(
        self, pose: Pose2D, radius: float, low: float, high: float, color: Any, top: Any = METAL
    ) -> None:
        """Draw an upright cylinder."""
        for z in (low, high):
            self.fill(_ring(pose, radius, z), color)
        ends = at(pose, 0.0, 0.0, np.array((low, high)))
        width = 2.0 * radius * self.camera.scale(ends.mean(axis=0))
        self.line(ends, color, width, solid_capstyle="butt")
        self.fill(_ring(pose, radius, high), top)

    def robot(self, robot: Robot, pose: Pose2D, turned: Sequence[float]) -> None:
        """Draw a robot with wheels at the angles `turned` [rad]."""
        base, camera, lidar = robot.base, robot.camera, robot.lidar
        wheels = [
            (at(pose, *robot.wheel_position(name)), partial(self._wheel, robot, pose, name, angle))
            for name, angle in zip(WHEELS, turned, strict=True)
        ]
        wheels.sort(key=lambda wheel: -float(self.camera.depth(wheel[0])))
        for _, draw in wheels[:2]:
            draw()
        size = base.length_m, base.width_m, base.height_m
        self.box(pose, size, base.clearance_m, YELLOW)
        for _, draw in wheels[2:]:
            draw()
        assert lidar is not None
        assert camera is not None
        x, y, z = lidar.position_m
        radius, height = lidar.size_m
        top = base.clearance_m + base.height_m
        self.pillar(pose.compose(Pose2D(x, y)), radius, top, z + height / 2, DARK)
        x, y, z = camera.position_m
        low = z - camera.size_m[2] / 2
        self.box(pose.compose(Pose2D(x, y)), camera.size_m, low, BLACK)

    def _wheel(self, robot: Robot, pose: Pose2D, name: str, angle: float) -> None:
        x, y, z = robot.wheel_position(name)
        radius, half = robot.wheels.radius_m, robot.wheels.hub_width_m / 2.0
        c, s = radius * np.cos(_CIRCLE), radius * np.sin(_CIRCLE)
        sides = [at(pose, x + c, y + side, z + s) for side in (-half, half)]
        sides.sort(key=lambda ring: -float(self.camera.depth(ring).mean()))
        far, near = sides
        for a, b, d, e in zip(far, far[1:], near[1:], near, strict=False):
            self.fill(np.array((a, b, d, e)), DARK, edgecolor=DARK, linewidth=0.3)
        self.fill(near, METAL)
        middle = near.mean(axis=0)
        width = 0.012 * self.camera.scale(middle)
        for k in range(robot.rollers.count):
            phase = angle + math.tau * k / robot.rollers.count
            out = radius * np.array((math.sin(phase), math.cos(phase)))
            rim = at(pose, x + out[0], y, z - out[1]) - at(pose, x, y, z)
            self.line(np.array((middle + 0.55 * rim, middle + 0.95 * rim)), LIGHT_METAL, width)
        self.fill(middle + 0.35 * (near - middle), LIGHT_METAL)

    def outline(self, pose: Pose2D, half: Sequence[float], color: Any, width_px: float) -> None:
        """Draw a rectangle of half length and width `half` [m] on the ground, with a mark ahead."""
        corners = np.vstack((_CORNERS, _CORNERS[:1])) * 2.0 * half
        self.line(at(pose, corners[:, 0], corners[:, 1], 0.0), color, width_px)
        self.line(at(pose, half[0] * np.array((0.0, 1.5)), 0.0, 0.0), color, width_px)

    def far_to_near(self, things: Iterable[tuple[Array, Draw]]) -> None:
        """Draw objects with positions (..., 3) from the farthest to the nearest."""
        for _, draw in sorted(things, key=lambda thing: -float(self.camera.depth(thing[0]).mean())):
            draw()


def sheet(panels: Sequence[Image.Image], columns: int = 3, gap_px: int = 6) -> Image.Image:
    """Return panels of one size side by side, in rows."""
    width, height = (edge + gap_px for edge in panels[0].size)
    rows = math.ceil(len(panels) / columns)
    whole = Image.new("RGB", (columns * width - gap_px, rows * height - gap_px), "white")
    for k, panel in enumerate(panels):
        whole.paste(panel, (k % columns * width, k // columns * height))
    return whole


def at(pose: Pose2D, x: Any, y: Any, z: Any) -> Array:
    """Transform points of a planar frame to world (..., 3) [m]."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    x, y, z = np.broadcast_arrays(x, y, z)
    return np.stack((pose.x + c * x - s * y, pose.y + s * x + c * y, z), axis=-1)


def beams(scan: m.LaserScan, lidar: Sequence[float], robot: Pose2D) -> tuple[Array, Array]:
    """Return the hits of beams (k, 3) at the lidar's height, and all ends on the ground."""
    ranges = np.array(scan.ranges)
    hit = (ranges >= scan.range_min) & (ranges <= scan.range_max)
    ends = np.where(hit, ranges, scan.range_max)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    x, y = lidar[0] + ends * np.cos(angles), lidar[1] + ends * np.sin(angles)
    return at(robot, x[hit], y[hit], lidar[2]), at(robot, x, y, 0.0)


def _ring(pose: Pose2D, radius: float, z: float) -> Array:
    return at(pose, radius * np.cos(_CIRCLE), radius * np.sin(_CIRCLE), z)


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit
