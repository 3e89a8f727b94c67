"""A scene in DART: the ground, one or several robots, and the objects close to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any, Literal

import dartpy as dart
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.robot import Robot

from mecazen_physics import bodies
from mecazen_physics.people import MovingPerson, place

CONE_TOLERANCE = 1e-6
"""Tolerance of the friction-cone solver: at 1e-5 a robot at rest with strained wheels creeps by 14
µm/s."""
MAX_SWEEPS, MAX_SWEEPS_OF_SEVERAL = 100, 25
"""Maximum number of sweeps of the friction-cone solver per step: with one robot, with several.

If wheels are strained, the solver rarely converges. With 25 sweeps, two robots that strafe take
half the time, and after 0.26 m are 0.1 mm from their position with 1000 sweeps. But a single robot
with rollers at 30° would turn 1 % less on the spot.
"""
SLIP_SHARE = 0.8
"""Share of the friction cone from which on a contact may slip soon, so that the cone is solved."""
UPRIGHT = 0.99
"""Minimum vertical component of the normal of a contact with the ground."""

Layer = Literal["ground", "obstacle", "person", "plane", "base", "wheel", "roller"]
Layers = Mapping[Layer, Sequence[Any]]
"""Bodies by layer."""
_TOUCHING = {
    frozenset(pair)
    for pair in (
        *product(("ground",), ("base", "roller")),
        *product(("base", "wheel"), ("base", "wheel", "obstacle", "person")),
    )
}
"""The layers whose bodies collide.

Across gaps of up to 30 mm between two rollers, or 20 mm between a roller and a box, Bullet still
finds contacts, many times deeper than a roller is thick. So rims of wheels collide instead. Each
plane collides with one roller, which is set by `Scene.allow`. Persons collide only with robots.
"""


class Scene:
    """The ground in DART, with one robot, or several robots that are close to each other.

    People and obstacles are in the scene while they are close. `step(False)` simulates a step of
    `dt_s`.

    DART's default solver limits friction by a box along two horizontal axes, not by Coulomb's cone:
    between these axes a force can be √2 too large. A roller resists only along its own axis, so the
    box is exact if its axes are those of the rollers. For rollers at 45°, DART's axes are turned
    with a robot that is alone. In all other cases DART solves for the cone while any contact is
    about to slip, which takes up to five times as long.
    """

    def __init__(self, robot: Robot, physics: PhysicsConfig, world: WorldConfig) -> None:
        self._robot, self._world = robot, world
        self._slope = math.radians(world.slope_deg), math.radians(world.slope_heading_deg)
        self._friction = min(bodies.ground_frictions(robot, world))
        self.dart = dart.simulation.World()
        self.dart.setTimeStep(physics.dt_s)
        self._alignable = robot.rollers.angle_deg == 45.0
        self.turn(0.0)
        self._solver = self.dart.getConstraintSolver()
        self._box = self._solver.getBoxedLcpSolver()
        self._cone = dart.constraint.NsgsFrictionSolver()
        self.solves_cone = False
        """Whether friction is limited by Coulomb's cone, not by the box."""
        self.dart.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self.dart.getDeactivationOptions()
        sleep.mEnabled = False
        self.dart.setDeactivationOptions(sleep)
        self._known: list[Any] = []
        """The skeletons that have been in the scene."""
        self._layers: dict[Layer, list[Any]] = {}
        """The bodies of the known skeletons, by layer."""
        self.people: dict[int, Any] = {}
        """The skeletons of all people that have been present, by number."""
        self._present: set[int] = set()
        self._has_obstacles = False
        self._ground = bodies.build_ground(robot, world)
        self.add(self._ground, {"ground": self._ground.getBodyNodes()})
        self.step = self.dart.step

    @cached_property
    def _obstacles(self) -> Any:
        return bodies.build_obstacles(bodies.reachable(self._robot, self._world))

    def add(self, skeleton: Any, layers: Layers) -> None:
        """Add a skeleton, whose bodies collide with those of the layers in `_TOUCHING`."""
        self.dart.addSkeleton(skeleton)
        if any(skeleton is known for known in self._known):
            return
        self._known.append(skeleton)
        for layer, nodes in layers.items():
            for other, others in self._layers.items():
                if frozenset((layer, other)) not in _TOUCHING:
                    self.keep_apart(nodes, others)
            self._layers.setdefault(layer, []).extend(nodes)

    def remove(self, skeleton: Any) -> None:
        """Remove a skeleton."""
        self.dart.removeSkeleton(skeleton)
        self.renew_detector()

    def renew_detector(self) -> None:
        """Make DART find contacts in the order of the bodies, after bodies or shapes have changed.

        DART removes changed bodies from its detector in the order of memory addresses, which differ
        between processes. This order determines the order of contacts, which determines the last
        bit of the contact forces. A new detector adds all bodies in their own order.
        """
        self.dart.setCollisionDetector(dart.simulation.BULLET)

    def allow(self, body: Any, other: Any) -> None:
        """Let a plane and a roller collide."""
        collisions = self._solver.getCollisionOption().collisionFilter
        collisions.removeBodyNodePairFromBlackList(body, other)

    def show(self, people: Mapping[int, MovingPerson], *, obstacles: bool) -> None:
        """Choose the people that are present, by number, and whether obstacles are.

        People who are present already are not moved: DART integrates their velocity.
        """
        if obstacles != self._has_obstacles:
            self._has_obstacles = obstacles
            if obstacles:
                self.add(self._obstacles, {"obstacle": self._obstacles.getBodyNodes()})
            else:
                self.remove(self._obstacles)
        if people.keys() == self._present:
            return
        for number in self._present - people.keys():
            self.remove(self.people[number])
        for number in sorted(people.keys() - self._present):
            if number not in self.people:
                self.people[number] = self._build_person(number, people[number])
            self.add(self.people[number], {"person": self.people[number].getBodyNodes()})
            place(self.people[number], people[number])
        self._present = set(people)

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Move a person who is present in the scene."""
        if number in self._present:
            place(self.people[number], person)

    def turn(self, heading: float) -> None:
        """Turn DART's axes to `heading` from the world's [rad]; bodies are not changed."""
        self.heading = heading
        slope, uphill = self._slope
        along, uphill = -bodies.GRAVITY * math.sin(slope), uphill - heading
        down = -bodies.GRAVITY * math.cos(slope)
        self.dart.setGravity([along * math.cos(uphill), along * math.sin(uphill), down])

    def choose_solver(self, *, alone: bool, robots: int) -> None:
        """Choose the cone solver if a contact is about to slip, otherwise the box solver.

        Args:
            alone: Whether only the ground can touch the only robot.
            robots: The number of robots.
        """
        cone = not (alone and self._alignable) and self._may_slip()
        if cone:
            options = self._cone.getOptions()
            options.tolerance = CONE_TOLERANCE
            options.maxSweeps = MAX_SWEEPS if robots == 1 else MAX_SWEEPS_OF_SEVERAL
            self._cone.setOptions(options)
        if cone != self.solves_cone:
            self.solves_cone = cone
            self._solver.setBoxedLcpSolver(self._cone if cone else self._box)

    def alignment(self, yaw: float) -> float | None:
        """Return the angle from DART's axes to the rollers' of a robot at `yaw`, at most 45° [rad].

        The result is None if rollers are not at right angles to each other.
        """
        if not self._alignable:
            return None
        return math.remainder(yaw - math.pi / 4.0 - self.heading, math.pi / 2.0)

    def _may_slip(self) -> bool:
        """Return whether any ground force in the last step was near the friction cone.

        Contacts of a base that scrapes along an obstacle are ignored. Rims have no friction.
        """
        for contact in self.dart.getLastCollisionResult().getContacts():
            nx, ny, nz = contact.normal.tolist()
            if abs(nz) >= UPRIGHT or self._world.ridges:
                x, y, z = contact.force.tolist()
                along = x * nx + y * ny + z * nz
                friction = math.hypot(x - along * nx, y - along * ny, z - along * nz)
                if friction > SLIP_SHARE * self._friction * abs(along):
                    return True
        return False

    def _build_person(self, number: int, person: MovingPerson) -> Any:
        stands = person.legs is None
        skeleton = bodies.build_person(self._world.person) if stands else bodies.build_legs()
        skeleton.setName(f"person_{number}")
        return skeleton

    def keep_apart(self, nodes: Sequence[Any], others: Sequence[Any]) -> None:
        """Disable collisions between `nodes` and `others`."""
        collisions = self._solver.getCollisionOption().collisionFilter
        for node, other in product(nodes, others):
            collisions.addBodyNodePairToBlackList(node, other)
