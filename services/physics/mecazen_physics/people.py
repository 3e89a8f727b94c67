"""Contact shapes of people: an upright cylinder, or the limbs that a robot can reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.portable import Floats
from mecazen.skeleton import INDEX, LIMBS

from mecazen_physics.footprint import Footprint

FASTEST_PERSON = 20.0
"""Largest speed of a person between two samples [m/s]; faster people would shove robots."""
FASTEST_PUSH = 10.0
"""Largest speed with which a person pushes robots [m/s]."""
LEGS = [limb for limb in LIMBS if limb.name.endswith(("thigh", "shank", "foot"))]
"""The limbs that robots can reach."""
_BEGINS = [INDEX[limb.begin] for limb in LEGS]
_ENDS = [INDEX[limb.end] for limb in LEGS]
RADII = np.array([limb.radius for limb in LEGS])
"""Radii of `LEGS`, as shares of the body's height."""
SIDEWAYS = np.array((1.0, 1.0, 0.0))
"""The directions in which limbs push robots. Nothing yields between the ground and a foot that
comes down on a robot: the foot would shoot it aside at many times its own speed."""


class Legs(NamedTuple):
    """The axes of the capsules `LEGS`: begins and ends (6, 3) [m], and their velocities [m/s]."""

    begins: Floats
    ends: Floats
    begin_velocities: Floats
    end_velocities: Floats
    height: float
    """Height of the body [m]."""


class MovingPerson(NamedTuple):
    """A person's position [m] and velocity (2,) [m/s] in the world frame."""

    x: float
    y: float
    velocity: tuple[float, float]
    legs: Legs | None = None
    """The legs of a person with joints, which robots touch."""

    @classmethod
    def upright(cls, pose: Pose2D, velocity: Twist2D) -> MovingPerson:
        """Return a person at `pose`, moving with `velocity` in their own frame."""
        slower = FASTEST_PUSH / max(math.hypot(velocity.x, velocity.y), FASTEST_PUSH)
        velocity_x, velocity_y = velocity.x * slower, velocity.y * slower
        return cls(pose.x, pose.y, rotate(velocity_x, velocity_y, pose.yaw))

    @classmethod
    def of_joints(cls, joints: Floats, velocities: Floats, height: float) -> MovingPerson:
        """Return a person whose joints (20, 3) [m] move with `velocities` (20, 3) [m/s].

        Joints are in the order of `mecazen.skeleton.JOINTS`, in the world frame.
        """
        sideways = velocities * SIDEWAYS
        legs = Legs(joints[_BEGINS], joints[_ENDS], sideways[_BEGINS], sideways[_ENDS], height)
        pelvis = INDEX["pelvis"]
        (x, y, _), (vx, vy, _) = joints[pelvis].tolist(), velocities[pelvis].tolist()
        return cls(x, y, (vx, vy), legs)

    def standing(self) -> MovingPerson:
        """Return the person at rest."""
        legs = self.legs
        if legs is not None:
            still = np.zeros_like(legs.begins)
            legs = legs._replace(begin_velocities=still, end_velocities=still)
        return MovingPerson(self.x, self.y, (0.0, 0.0), legs)

    def after(self, duration: float) -> MovingPerson:
        """Return the person `duration` [s] later, at the same velocities."""
        (vx, vy), legs = self.velocity, self.legs
        if legs is not None:
            legs = legs._replace(
                begins=legs.begins + duration * legs.begin_velocities,
                ends=legs.ends + duration * legs.end_velocities,
            )
        return MovingPerson(self.x + vx * duration, self.y + vy * duration, self.velocity, legs)

    def footprint(self, radius: float) -> Footprint:
        """Return the circle round all touchable parts: legs reach beyond `radius` [m]."""
        speed = math.hypot(*self.velocity)
        if self.legs is not None:
            begins, ends, *velocities, height = self.legs
            out = np.concatenate((begins, ends))[:, :2] - (self.x, self.y)
            reaches = np.hypot(*out.T) + np.tile(height * RADII, 2)
            radius = float(np.max(reaches))
            speed = float(np.max(np.linalg.norm(np.concatenate(velocities), axis=1)))
        return Footprint(self.x, self.y, rim=radius, speed=speed)


class ReportedPerson:
    """A person who is reported by samples: estimates joint velocities, and checks plausibility."""

    def __init__(self) -> None:
        self._points: Sequence[Sequence[float]] | None = None
        self._time = 0.0

    def velocities(self, points: Sequence[Sequence[float]], time: float, gap_s: float) -> Floats:
        """Return the velocities of points (n, 2 or 3) [m] at `time` [s], 0 in the first sample.

        Raises:
            RefusedError: The points can't be reached from the last ones in `gap_s`: a person who
                jumps would shove a robot.
        """
        places = np.array(points)
        velocities = np.zeros_like(places)
        if self._points is not None:
            steps = map(math.dist, points, self._points)
            if not all(step <= FASTEST_PERSON * gap_s for step in steps):  # as for NaN
                fastest = f"faster than {FASTEST_PERSON:g} m/s"
                raise RefusedError(f"the person moved {fastest} since the last sample")
            if time > self._time:
                velocities = (places - np.array(self._points)) / (time - self._time)
                speeds = np.linalg.norm(velocities, axis=1, keepdims=True)
                velocities *= FASTEST_PUSH / np.maximum(speeds, FASTEST_PUSH)
        self._points, self._time = points, time
        return velocities


def place(skeleton: Any, person: MovingPerson) -> None:
    """Set position and velocity of a person's DART skeleton."""
    if person.legs is None:
        skeleton.setPositions([person.x, person.y])
        skeleton.setCommands(person.velocity)
        return
    begins, ends, begin_velocities, end_velocities, height = person.legs
    along, turning = ends - begins, end_velocities - begin_velocities
    up = along[:, 2:] < 0.0  # a capsule has no direction: none is turned by more than 90°
    along, turning = np.where(up, -along, along), np.where(up, -turning, turning)
    lengths = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    axes = along / lengths
    positions, velocities = np.zeros((len(LEGS), 6)), np.zeros((len(LEGS), 6))
    positions[:, :3] = [_from_vertical(axis) for axis in axes.tolist()]
    positions[:, 3:] = (begins + ends) / 2
    velocities[:, :3] = np.cross(axes, turning / lengths)
    velocities[:, 3:] = (begin_velocities + end_velocities) / 2
    sizes = np.stack((lengths[:, 0], height * RADII), axis=-1).tolist()
    for body, (length, radius) in zip(skeleton.getBodyNodes(), sizes, strict=True):
        shape = body.getShapeNode(0).getShape()
        # DART builds the shape again for a new size
        if abs(shape.getHeight() - length) > 1e-3 or shape.getRadius() != radius:
            shape.setHeight(length)
            shape.setRadius(radius)
    skeleton.setPositions(positions.ravel())
    skeleton.setCommands(velocities.ravel())


def _from_vertical(axis: Sequence[float]) -> tuple[float, float, float]:
    """Return the rotation vector [rad] of the shortest turn that takes z to a unit vector."""
    x, y, z = axis
    sine = math.hypot(x, y)
    scale = math.atan2(sine, z) / sine if sine > 0.0 else 0.0
    return -y * scale, x * scale, 0.0
