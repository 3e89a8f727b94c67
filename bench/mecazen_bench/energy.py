"""The kinetic energy of a robot from its motion, which every engine reports alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mecazen.robot import Robot
from mecazen_physics import model
from mecazen_physics.model import Link


class Sample(NamedTuple):
    """Pose of the robot: base_link's origin in world [m], its yaw, and the wheels' angles [rad]."""

    x: float
    y: float
    z: float
    yaw: float
    wheels: Sequence[float]

    @classmethod
    def of(
        cls, position: Sequence[float], quaternion: Sequence[float], wheels: Sequence[float]
    ) -> Sample:
        """Return the sample of a position (x, y, z) and an orientation (x, y, z, w)."""
        qx, qy, qz, qw = quaternion
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        x, y, z = position
        return cls(x, y, z, yaw, wheels)


@dataclass(frozen=True)
class Body:
    """The inertia of a robot that moves in the plane.

    With v the speed of base_link, ψ̇ its yaw rate and ω the angular speed of each wheel,

        E = ½·m·v² + ½·J·ψ̇² + ½·I·Σω².

    Rollers turn with their wheel, but not about their own axes, as where the robot rolls
    straight on. Then no force does work, since the contact point has no velocity: E is constant.
    """

    mass: float
    """Of everything [kg]."""
    yaw_inertia: float
    """Of everything about base_link's z axis [kg·m²]."""
    wheel_inertia: float
    """Of a wheel with its rollers about its axle [kg·m²]."""

    @classmethod
    def of(cls, robot: Robot) -> Body:
        """Return the inertia of `robot`, by the parallel axis theorem."""
        links = model.links(robot)
        wheels = {link.name: link for link in links if link.axis and link.parent == "base_link"}
        parts = [model.base(robot), *links]
        yaw = 0.0
        for link in parts:
            place = np.add(link.translation, link.centre)
            if link.parent in wheels:
                place = place + wheels[link.parent].translation
            yaw += _moment(link, 2) + link.mass * float(place[:2] @ place[:2])
        first, *_ = wheels.values()
        axle = _moment(first, 1)
        for link in links:
            if link.parent == first.name:
                x, _, z = link.translation
                axle += _moment(link, 1) + link.mass * (x * x + z * z)
        return cls(sum(link.mass for link in parts), yaw, axle)

    def energy(self, before: Sample, after: Sample, duration: float) -> float:
        """Return the energy [J] at the mean speeds between two samples `duration` [s] apart."""
        distance = math.hypot(after.x - before.x, after.y - before.y)
        turn = math.remainder(after.yaw - before.yaw, 2.0 * math.pi)
        spins = np.subtract(after.wheels, before.wheels)
        squares = self.mass * distance**2 + self.yaw_inertia * turn**2
        return float(squares + self.wheel_inertia * (spins @ spins)) / (2.0 * duration**2)


def _moment(link: Link, axis: int) -> float:
    """Return the moment of inertia about an axis of the parent, through the link's centre."""
    return float(np.square(link.rotation[axis]) @ np.array(link.moments))
