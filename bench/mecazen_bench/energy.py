"""The kinetic energy of a robot from its motion, which every engine reports alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from mecazen.robot import WHEELS, Robot
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


class Body(NamedTuple):
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
        """Return the inertia of `robot`."""
        links = [model.base(robot), *model.links(robot)]
        places = {"": (0.0, 0.0, 0.0)} | {link.name: link.translation for link in links}

        def in_base(link: Link) -> Link:
            x, y, z = np.add(places[link.parent], link.translation).tolist()
            return replace(link, translation=(x, y, z))

        mass, centre, inertia = model.lump([in_base(link) for link in links])
        hub, *rollers = (link for link in links if link.name.startswith(WHEELS[0]))
        _, _, wheel = model.lump([replace(hub, translation=(0.0, 0.0, 0.0)), *rollers])
        yaw_inertia = inertia[2, 2] + mass * (centre[:2] @ centre[:2])
        return cls(mass, float(yaw_inertia), float(wheel[1, 1]))

    def energy(self, before: Sample, after: Sample, duration: float) -> float:
        """Return the energy [J] at the mean speeds between two samples `duration` [s] apart."""
        distance = math.hypot(after.x - before.x, after.y - before.y)
        turn = math.remainder(after.yaw - before.yaw, 2.0 * math.pi)
        spins = np.subtract(after.wheels, before.wheels)
        squares = self.mass * distance**2 + self.yaw_inertia * turn**2
        return float(squares + self.wheel_inertia * (spins @ spins)) / (2.0 * duration**2)
