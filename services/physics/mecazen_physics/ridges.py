"""Ramps and sills under the rollers: a plane for each roller that is about to touch one.

Only a plane has smooth contacts with a roller. A roller and a ridge are both convex. So the plane
through the nearest point of the ridge, at right angles to the shortest line to the roller,
separates them, and a contact with the plane is a contact with the ridge. The planes are placed
again before each step, so rollers roll over edges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import dartpy as dart
import numpy as np
from mecazen.config.world import Ridge
from mecazen.portable import Floats
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import Roller

from mecazen_physics.body import RobotBody
from mecazen_physics.world import DartWorld, add_shape

NEAR_M = 0.002
"""A roller this close to a ridge gets a plane: no roller moves farther within a step."""
PLANES = 3 * len(WHEELS)
"""Number of planes: a wheel touches a ridge with at most two rollers, and may touch a second
ridge."""


class Profile:
    """The surface of a ridge, for distances to it."""

    def __init__(self, ridge: Ridge) -> None:
        foot, edge = ridge.top / 2 + ridge.run, ridge.top / 2
        self._corners = np.array(
            ((-foot, 0.0), (-edge, ridge.rise), (edge, ridge.rise), (foot, 0.0))
        )
        self._along = np.diff(self._corners, axis=0)
        self._squares = np.sum(self._along**2, axis=1)
        x, y, yaw = ridge.middle
        c, s = math.cos(yaw), math.sin(yaw)
        self._origin, self._across = np.array((x, y)), np.array((-s, c))
        self._ahead = np.array((c, s))
        self._half_width = ridge.width / 2

    def nearest(self, points: Floats) -> tuple[Floats, Floats]:
        """Return distances (n,) [m] to points (n, 3), and unit vectors (n, 2) to the points.

        The components of a vector are along the driving direction across the ridge, and up. For
        points beside the ridge, or below its surface, distances are infinite.
        """
        flat = points[:, :2] - self._origin
        section = np.stack((_along(flat, self._ahead), points[:, 2]), axis=-1)
        from_corner = section[:, None] - self._corners[:-1]
        share = np.sum(from_corner * self._along, axis=2) / self._squares
        ways = from_corner - np.clip(share, 0.0, 1.0)[:, :, None] * self._along
        far = np.sqrt(np.sum(ways**2, axis=2))
        piece = np.argmin(far, axis=1)
        rows = np.arange(len(points))
        ways, distances = ways[rows, piece], far[rows, piece]
        inside = np.abs(_along(flat, self._across)) <= self._half_width
        distances = np.where(inside & (ways[:, 1] > 0.0), distances, np.inf)
        ways = ways / np.where(far[rows, piece] > 0.0, far[rows, piece], 1.0)[:, None]
        return distances, ways

    def plane(self, point: Floats, distance: float, way: Floats) -> Any:
        """Return the pose of the plane at the surface point nearest to `point` (3,)."""
        along, up = way.tolist()
        (x, y), (left_x, left_y) = self._ahead.tolist(), self._across.tolist()
        normal = along * x, along * y, up
        axes = (up * x, left_x, normal[0]), (up * y, left_y, normal[1]), (-along, 0.0, up)
        return dart.math.Isometry3(axes, point - distance * np.array(normal))


def _along(points: Floats, axis: Floats) -> Floats:
    """Return the coordinates of points (n, 2) along an axis (2,), without BLAS."""
    along: Floats = points[:, 0] * axis[0] + points[:, 1] * axis[1]
    return along


class RidgeContacts:
    """The planes that carry a robot's rollers over ridges."""

    def __init__(
        self, robot: Robot, ridges: Sequence[Ridge], body: RobotBody, friction: float
    ) -> None:
        self._profiles = [Profile(ridge) for ridge in ridges]
        self._hubs, self._rollers = body.hubs, body.rollers
        centres, self._radii = Roller.from_robot(robot).spheres(robot.rollers.hull_spheres)
        self._centres, self._count = centres, robot.rollers.count
        reach = float(np.max(np.abs(centres) + self._radii))
        self._bound = reach + NEAR_M
        self._wheel_bound = math.hypot(robot.wheels.radius_m, reach) + NEAR_M
        self._skeleton = dart.dynamics.Skeleton("planes")
        pairs = [self._skeleton.createWeldJointAndBodyNodePair() for _ in range(PLANES)]
        self._joints, self._planes = zip(*pairs, strict=True)
        for plane in self._planes:
            add_shape(plane, dart.dynamics.PlaneShape([0.0, 0.0, 1.0], 0.0), friction)
        self._skeleton.setMobile(False)
        self._carried: dict[int, tuple[int, int]] = {}
        """The ridge and the roller of each plane in use."""

    def enter(self, world: DartWorld) -> None:
        """Add the planes to a world."""
        world.add(self._skeleton, {"plane": self._planes})

    def leave(self, world: DartWorld) -> None:
        """Remove all planes from a world."""
        self._assign(world, ())
        world.remove(self._skeleton)

    def lay(self, world: DartWorld) -> None:
        """Place the planes for the next step."""
        hubs = np.array([hub.getWorldTransform().translation() for hub in self._hubs])
        wanted: dict[tuple[int, int], tuple[float, Any]] = {}
        for ridge, profile in enumerate(self._profiles):
            for wheel in np.flatnonzero(profile.nearest(hubs)[0] < self._wheel_bound).tolist():
                numbers = range(wheel * self._count, (wheel + 1) * self._count)
                for number, gap, pose in self._touching(profile, numbers):
                    wanted[ridge, number] = gap, pose
        self._assign(world, sorted(wanted, key=lambda pair: wanted[pair][0])[:PLANES])
        for plane, pair in self._carried.items():
            self._joints[plane].setTransformFromParentBodyNode(wanted[pair][1])

    def _touching(
        self, profile: Profile, numbers: Sequence[int]
    ) -> Iterator[tuple[int, float, Any]]:
        """Yield number, gap [m] and pose of the plane for each of `numbers` near a ridge."""
        frames = np.array([self._rollers[n].getWorldTransform().matrix() for n in numbers])
        (close,) = np.nonzero(profile.nearest(frames[:, :3, 3])[0] < self._bound)
        if not len(close):
            return
        axes, middles = frames[close, :3, 2], frames[close, :3, 3]
        spheres = middles[:, None] + self._centres[:, None] * axes[:, None]
        distances, ways = profile.nearest(spheres.reshape(-1, 3))
        gaps = distances.reshape(len(close), -1) - self._radii
        firsts = np.argmin(gaps, axis=1)
        for index, (roller, first) in enumerate(zip(close.tolist(), firsts.tolist(), strict=True)):
            gap = float(gaps[index, first])
            if gap < NEAR_M:
                sphere = index * len(self._radii) + first
                distance, way = float(distances[sphere]), ways[sphere]
                pose = profile.plane(spheres[index, first], distance, way)
                yield numbers[roller], gap, pose

    def _assign(self, world: DartWorld, wanted: Sequence[tuple[int, int]]) -> None:
        """Assign a plane to each pair of ridge and roller; pairs keep their planes."""
        for plane, pair in [*self._carried.items()]:
            if pair not in wanted:
                world.keep_apart([self._planes[plane]], [self._rollers[pair[1]]])
                del self._carried[plane]
        new = [pair for pair in wanted if pair not in self._carried.values()]
        free = [plane for plane in range(PLANES) if plane not in self._carried]
        for plane, pair in zip(free, new, strict=False):
            world.allow(self._planes[plane], self._rollers[pair[1]])
            self._carried[plane] = pair
