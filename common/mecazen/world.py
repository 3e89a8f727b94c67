"""The section `[world]`: what surrounds the robots, for every service that needs to know it.

The world frame's x-y plane is the ground. Static obstacles stand on it; a slope leans gravity.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from mecazen.schema import AngleDeg, Finite, NonNegative, Positive, Section


class Box(Section, tag_field="kind", tag="box", frozen=True, kw_only=True):
    """A static box that stands on the ground, higher than the wheels' axles."""

    size_m: tuple[Positive, Positive, Positive]
    """Length (x), width (y), height (z)."""
    position_m: tuple[Finite, Finite]
    """Its centre in the world frame."""
    yaw_deg: AngleDeg = 0.0
    """Its heading in the world frame."""
    friction: NonNegative = 1.0
    """Coulomb coefficient between it and the robot."""


class Cylinder(Section, tag_field="kind", tag="cylinder", frozen=True, kw_only=True):
    """A static upright cylinder that stands on the ground, higher than the wheels' axles."""

    size_m: tuple[Positive, Positive]
    """Radius, height."""
    position_m: tuple[Finite, Finite]
    """Its centre in the world frame."""
    friction: NonNegative = 1.0
    """Coulomb coefficient between it and the robot."""


class Person(Section, frozen=True, kw_only=True):
    """The body of a person: an upright cylinder that robots can touch but not move."""

    radius_m: Positive = 0.2
    height_m: Positive = 1.75
    friction: NonNegative = 0.5
    """Coulomb coefficient between it and the robot."""


class WorldConfig(Section, frozen=True, kw_only=True):
    """The ground, the obstacles on it and the body of every person."""

    ground_friction: NonNegative = 1.0
    """Coulomb coefficient of the ground; the rollers' own multiplies it."""
    slope_deg: Annotated[float, msgspec.Meta(ge=0.0, le=45.0)] = 0.0
    """Inclination of the ground. The world frame is the ground's: gravity leans."""
    slope_heading_deg: AngleDeg = 0.0
    """Direction uphill in the world frame."""
    obstacles: tuple[Box | Cylinder, ...] = ()
    """Static bodies."""
    person: Person = Person()
    """The body of each person that a robot follows."""
