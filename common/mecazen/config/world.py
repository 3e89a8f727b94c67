"""`[world]`: the ground, the obstacles on it and the body of every person.

The world frame's x-y plane is the ground. Static obstacles stand on it; a slope leans gravity.
Code that needs shapes treats walls and tables as boxes (`WorldConfig.solids`), and ramps and sills
as ridges (`WorldConfig.ridges`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec

from mecazen.config.people import Passerby
from mecazen.geometry import Pose2D
from mecazen.schema import AngleDeg, Finite, NonNegative, Positive, Section

HIGHEST_SILL_M = 0.01
"""Robots are measured to cross sills up to this height: docs/world.md."""
SILL_BEVEL = 2.0
"""Run by rise of a sill's bevels: 1:2, as thresholds have by ICC A117.1 and the ADA standards."""
STEEPEST = 0.08
"""Rise by run of the steepest ramp, just below the 1:12 of the same standards."""
TABLE_TOP_M, TABLE_LEG_M = 0.04, 0.05
"""Thickness of a table's top, and width of its four square legs."""
RAIL_M = 0.05, 0.9
"""Thickness and height of a ramp's rails."""


class Box(Section, tag_field="kind", tag="box", frozen=True, kw_only=True):
    """A static box: above the ground, or on it and higher than the wheels' axles."""

    size_m: tuple[Positive, Positive, Positive]
    """Length (x), width (y), height (z)."""
    position_m: tuple[Finite, Finite]
    """Its centre in the world frame."""
    yaw_deg: AngleDeg = 0.0
    """Its heading in the world frame."""
    bottom_m: NonNegative = 0.0
    """Height of its underside above the ground."""


class Cylinder(Section, tag_field="kind", tag="cylinder", frozen=True, kw_only=True):
    """A static upright cylinder on the ground, higher than the wheels' axles."""

    size_m: tuple[Positive, Positive]
    """Radius, height."""
    position_m: tuple[Finite, Finite]
    """Its centre in the world frame."""

    @property
    def bottom_m(self) -> float:
        """Height of its underside above the ground."""
        return 0.0


class Ridge(NamedTuple):
    """A slope up, a level top and the same slope down, for rollers.

    `middle` is the pose of the middle of the top in the world frame; its x axis leads across. `run`
    is the length of each slope on the ground, `top` that of the top, both along x, `width` the
    whole width along y, and `rise` the height of the top, all in [m].
    """

    middle: Pose2D
    run: float
    top: float
    rise: float
    width: float


class Door(Section, frozen=True, kw_only=True):
    """A gap in a wall, over its whole height."""

    at_m: Positive
    """Distance along the wall from its first point to the door's middle."""
    width_m: Positive
    sill_m: Annotated[float, msgspec.Meta(ge=0.0, le=HIGHEST_SILL_M)] = 0.0
    """Height of the sill, which is as deep as the wall, between bevels of 1:2."""


class Wall(Section, frozen=True, kw_only=True):
    """A wall along a line of straight pieces."""

    points_m: Annotated[tuple[tuple[Finite, Finite], ...], msgspec.Meta(min_length=2)]
    """The centre line of the wall, in the world frame."""
    thickness_m: Positive = 0.1
    height_m: Positive = 2.0
    doors: tuple[Door, ...] = ()

    def __post_init__(self) -> None:
        if any(length == 0.0 for _, _, length in self._pieces()):
            raise ValueError("points_m: two points that follow each other must differ")
        edges = sorted((d.at_m - d.width_m / 2, d.at_m + d.width_m / 2) for d in self.doors)
        if any(end > begin for (_, end), (begin, _) in pairwise(edges)):
            raise ValueError("doors: two of them overlap")
        for begin, end in edges:
            if not any(a <= begin and end <= a + length for _, a, length in self._pieces()):
                raise ValueError(
                    f"doors: one from {begin:g} m to {end:g} m along the wall is not within one of "
                    "its straight pieces"
                )

    def _pieces(self) -> Iterator[tuple[Pose2D, float, float]]:
        """Yield each straight piece: start pose, distance of the start along the wall, length."""
        along = 0.0
        for (x, y), (to_x, to_y) in pairwise(self.points_m):
            length = math.hypot(to_x - x, to_y - y)
            yield Pose2D(x, y, math.atan2(to_y - y, to_x - x)), along, length
            along += length

    def boxes(self) -> Iterator[Box]:
        """Yield the boxes between the doors; pieces extend into the corners that they share."""
        last, is_closed = len(self.points_m) - 2, self.points_m[0] == self.points_m[-1]
        for number, (start, along, length) in enumerate(self._pieces()):
            begin = -self.thickness_m / 2 if number > 0 or is_closed else 0.0
            end = length + (self.thickness_m / 2 if number < last or is_closed else 0.0)
            gaps = sorted(
                (door.at_m - along - door.width_m / 2, door.at_m - along + door.width_m / 2)
                for door in self.doors
                if along <= door.at_m <= along + length
            )
            edges = [begin, *(edge for gap in gaps for edge in gap), end]
            for a, b in zip(edges[::2], edges[1::2], strict=True):
                if b > a:
                    middle = start.compose(Pose2D((a + b) / 2, 0.0))
                    yield Box(
                        size_m=(b - a, self.thickness_m, self.height_m),
                        position_m=(middle.x, middle.y),
                        yaw_deg=math.degrees(start.yaw),
                    )

    def sills(self) -> Iterator[Ridge]:
        """Yield the sills of its doors."""
        for start, along, length in self._pieces():
            for door in self.doors:
                if door.sill_m > 0.0 and along <= door.at_m <= along + length:
                    middle = start.compose(Pose2D(door.at_m - along, 0.0, math.pi / 2))
                    run = SILL_BEVEL * door.sill_m
                    yield Ridge(middle, run, self.thickness_m, door.sill_m, door.width_m)


class Table(Section, frozen=True, kw_only=True):
    """A top on four legs, such as a table or a bed."""

    size_m: tuple[Positive, Positive, Positive]
    """Length (x), width (y), height of the top's upper side."""
    position_m: tuple[Finite, Finite]
    """Its centre in the world frame."""
    yaw_deg: AngleDeg = 0.0
    """Its heading in the world frame."""

    def __post_init__(self) -> None:
        length, width, height = self.size_m
        if height <= TABLE_TOP_M or min(length, width) < 2.0 * TABLE_LEG_M:
            raise ValueError(
                f"size_m = {list(self.size_m)}: length and width must be at least "
                f"{2.0 * TABLE_LEG_M:g} m, and the height above {TABLE_TOP_M:g} m"
            )

    def boxes(self) -> Iterator[Box]:
        """Yield the top and the legs."""
        (length, width, height), leg = self.size_m, TABLE_LEG_M
        below = height - TABLE_TOP_M
        yield self._box((length, width, TABLE_TOP_M), (0.0, 0.0), below)
        for i, j in product((1, -1), repeat=2):
            corner = i * (length - leg) / 2, j * (width - leg) / 2
            yield self._box((leg, leg, below), corner, 0.0)

    def _box(
        self, size: tuple[float, float, float], place: tuple[float, float], bottom: float
    ) -> Box:
        at = Pose2D(*self.position_m, math.radians(self.yaw_deg)).compose(Pose2D(*place))
        return Box(
            size_m=size,
            position_m=(at.x, at.y),
            yaw_deg=self.yaw_deg,
            bottom_m=bottom,
        )


class Ramp(Section, frozen=True, kw_only=True):
    """A slope up, a landing and an equal slope down, between rails."""

    length_m: Positive
    """Length of each slope on the ground."""
    width_m: Positive
    """Distance between the rails."""
    rise_m: Positive
    position_m: tuple[Finite, Finite]
    """The middle of the landing in the world frame."""
    heading_deg: AngleDeg = 0.0
    """Direction of driving over the ramp."""
    landing_m: Positive = 1.0
    """Length of the landing."""

    def __post_init__(self) -> None:
        if self.rise_m > STEEPEST * self.length_m:
            raise ValueError(
                f"rise_m = {self.rise_m:g} must be at most {STEEPEST:.0%} of "
                f"length_m = {self.length_m:g}"
            )

    @property
    def ridge(self) -> Ridge:
        """Slopes and landing, without the rails."""
        middle = Pose2D(*self.position_m, math.radians(self.heading_deg))
        return Ridge(middle, self.length_m, self.landing_m, self.rise_m, self.width_m)

    def boxes(self) -> Iterator[Box]:
        """Yield the rails, which keep robots from the sides."""
        size = 2.0 * self.length_m + self.landing_m, RAIL_M[0], RAIL_M[1]
        for side in (0.5, -0.5):
            at = self.ridge.middle.compose(Pose2D(0.0, side * (self.width_m + RAIL_M[0])))
            yield Box(size_m=size, position_m=(at.x, at.y), yaw_deg=self.heading_deg)


class Patch(Section, frozen=True, kw_only=True):
    """A rectangle of the ground with its own friction."""

    size_m: tuple[Positive, Positive]
    """Length (x), width (y)."""
    position_m: tuple[Finite, Finite]
    """Its centre in the world frame."""
    yaw_deg: AngleDeg = 0.0
    """Its heading in the world frame."""
    friction: NonNegative
    """Coulomb coefficient of this ground; physics multiplies it by the rollers'."""

    def covers(self, x: float, y: float) -> bool:
        """Return whether the patch covers a point of the ground [m]."""
        middle = Pose2D(*self.position_m, math.radians(self.yaw_deg))
        at = middle.between(Pose2D(x, y))
        return abs(at.x) <= self.size_m[0] / 2 and abs(at.y) <= self.size_m[1] / 2


class PersonConfig(Section, frozen=True, kw_only=True):
    """The body of a person: an upright cylinder that robots can touch but not move."""

    radius_m: Positive = 0.2
    height_m: Positive = 1.75


class WorldConfig(Section, frozen=True, kw_only=True):
    """The ground, the obstacles on it and the body of every person."""

    map: Path | None = None
    """An occupancy map of ROS's map_server (YAML): its boxes are added to `obstacles`."""
    ground_friction: NonNegative = 1.0
    """Coulomb coefficient of the ground; physics multiplies it by the rollers'."""
    slope_deg: Annotated[float, msgspec.Meta(ge=0.0, le=45.0)] = 0.0
    """Inclination of the ground. The world frame stays on the ground: gravity is inclined."""
    slope_heading_deg: AngleDeg = 0.0
    """Direction uphill in the world frame."""
    obstacles: tuple[Box | Cylinder, ...] = ()
    """Static bodies."""
    walls: tuple[Wall, ...] = ()
    tables: tuple[Table, ...] = ()
    ramps: tuple[Ramp, ...] = ()
    patches: tuple[Patch, ...] = ()
    """Where patches overlap, the last one applies."""
    added: dict[str, Box | Cylinder | Passerby] = msgspec.field(default_factory=dict)
    """Things, by name, that `mecazen world` has added to the running simulation."""
    person: PersonConfig = PersonConfig()
    """The body of each person that a robot follows."""

    @property
    def solids(self) -> tuple[Box | Cylinder, ...]:
        """Everything that stands in the world, as boxes and cylinders."""
        built: tuple[Wall | Table | Ramp, ...] = (*self.walls, *self.tables, *self.ramps)
        boxes = (box for thing in built for box in thing.boxes())
        added = (thing for thing in self.added.values() if not isinstance(thing, Passerby))
        return (*self.obstacles, *boxes, *added)

    @property
    def passersby(self) -> dict[str, Passerby]:
        """The people who were added, by name."""
        return {name: thing for name, thing in self.added.items() if isinstance(thing, Passerby)}

    @property
    def ridges(self) -> tuple[Ridge, ...]:
        """All ramps and sills, over which the rollers drive."""
        sills = (sill for wall in self.walls for sill in wall.sills())
        return (*(ramp.ridge for ramp in self.ramps), *sills)
