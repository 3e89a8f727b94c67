"""The kinetic energy of a robot, from where it is: what every engine can be asked alike."""

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
    """Where the robot is: base_link's origin in world [m], heading, and the wheels' [rad]."""

    x: float
    y: float
    z: float
    yaw: float
    wheels: Sequence[float]


@dataclass(frozen=True)
class Body:
    """A robot that moves in the plane, as the numbers that its energy depends on.

    With v the speed of base_link, ψ̇ its yaw rate and ω the turning of each wheel,

        E = ½·m·v² + ½·J·ψ̇² + ½·I·Σω².

    Rollers turn with their wheel; on their own axes they stand still, as they do where the
    robot rolls straight on. No force does work then, for the point that touches the ground has
    no velocity: E stays.
    """

    mass: float
    """Of everything [kg]."""
    yaw_inertia: float
    """Of everything about base_link's z axis [kg·m²]."""
    wheel_inertia: float
    """Of a wheel with its rollers about its axle [kg·m²]."""

    @classmethod
    def of(cls, robot: Robot) -> Body:
        """Return the numbers of `robot`, by the parallel axis theorem."""
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
        rollers = [link for link in links if link.parent == first.name]
        axle = _moment(first, 1)
        for link in rollers:
            x, _, z = link.translation
            axle += _moment(link, 1) + link.mass * (x * x + z * z)
        return cls(sum(link.mass for link in parts), yaw, axle)

    def energy(self, before: Sample, after: Sample, duration: float) -> float:
        """Return the energy [J] of the mean speeds between two samples."""
        way = math.hypot(after.x - before.x, after.y - before.y)
        turn = math.remainder(after.yaw - before.yaw, 2.0 * math.pi)
        spins = np.subtract(after.wheels, before.wheels)
        squares = self.mass * way**2 + self.yaw_inertia * turn**2
        return float(squares + self.wheel_inertia * (spins @ spins)) / (2.0 * duration**2)


def _moment(link: Link, axis: int) -> float:
    """Return the moment of inertia about an axis of the parent's, through the link's centre."""
    return float(np.square(link.rotation[axis]) @ np.array(link.moments))
