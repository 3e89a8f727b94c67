"""A world of DART: the ground, the obstacles, and the people who are close to a robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import dartpy as dart
import numpy as np
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.people import MovingPerson, place

CONE_TOLERANCE = 1e-6
"""Of the cone's solver: with 1e-5 a robot at rest creeps by 14 µm/s while its wheels strain."""
UPRIGHT = 0.99
"""The normal of a contact with the ground has at least so large a vertical part."""
_PROBE_DEPTH = 1e-4


class RobotBodies(NamedTuple):
    """A robot's skeleton, and which of its bodies are wheels, without rollers, and rollers."""

    skeleton: Any
    wheels: list[Any]
    rollers: list[Any]


class DartWorld:
    """A world of DART that robots of the rollers of `robot` stand in.

    `step(False)` simulates a step of `dt_s`.

    DART's default solver lets friction fill a box along its axes, not Coulomb's cone: up to √2
    too much in between. A roller resists along its axis alone, so the box is exact where that is
    along one of DART's axes. Rollers of 45° stand at right angles: for a robot by itself DART's
    axes are turned with it. Elsewhere a step in which any force leaves the cone can be simulated
    again with a solver of the cone, which takes two to four times as long.

    Args:
        robot: One of the robots.
        physics: How they are simulated.
        world: What surrounds them; without obstacles where a robot is isolated.
        isolated: Whether it is for one robot that nothing but the ground can touch.
        max_sweeps: The most that the solver of the cone takes in a step.

    Raises:
        UnsupportedError: if an obstacle is so low that `robot` could drive onto it.
    """

    def __init__(
        self,
        robot: Robot,
        physics: PhysicsConfig,
        world: WorldConfig,
        *,
        isolated: bool = False,
        max_sweeps: int = 100,
    ) -> None:
        self._shape = world.person
        self._slope = math.radians(world.slope_deg), math.radians(world.slope_heading_deg)
        self._friction = bodies.least_friction(robot, world)
        self.simulation = dart.simulation.World()
        self.simulation.setTimeStep(physics.dt_s)
        self.aligned = isolated and robot.rollers.angle_deg == 45.0
        """Whether DART's axes are turned so that those of the rollers are along them."""
        self._has_ridges = bool(world.ridges)
        self.turn(0.0)
        self._solver = self.simulation.getConstraintSolver()
        self._of_box = self._solver.getBoxedLcpSolver()
        self._of_cone = dart.constraint.NsgsFrictionSolver()
        options = self._of_cone.getOptions()
        options.tolerance = CONE_TOLERANCE
        options.maxSweeps = max_sweeps
        self._of_cone.setOptions(options)
        self.is_exact = False
        """Whether it solves for Coulomb's cone, not for the box."""
        self.simulation.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self.simulation.getDeactivationOptions()
        sleep.mEnabled = False
        self.simulation.setDeactivationOptions(sleep)
        self._surroundings = bodies.build_surroundings(robot, world)
        self.simulation.addSkeleton(self._surroundings)
        self.step = self.simulation.step
        self.people: dict[int, Any] = {}
        """The skeletons of all people that have been present, by their numbers."""
        self._present: set[int] = set()
        self._robots: list[RobotBodies] = []
        """All that have been in it."""
        self._planes: list[Any] = []
        """All that have carried rollers over ridges in it: each touches those that it may."""

    def add(self, robot: RobotBodies) -> None:
        """Add a robot: its rollers touch the ground, and the rims of its wheels all else.

        Where two rollers have up to 30 mm of air between them, or a roller and a box 20 mm, Bullet
        still finds contacts, many times as deep as a roller is thick.
        """
        self.simulation.addSkeleton(robot.skeleton)
        if robot not in self._robots:
            ground, *obstacles = self._surroundings.getBodyNodes()
            people = [body for one in self.people.values() for body in one.getBodyNodes()]
            self._keep_apart(robot.wheels, [ground])
            self._keep_apart(robot.rollers, [*obstacles, *people])
            for other in self._robots:
                self._keep_apart(robot.rollers, other.skeleton.getBodyNodes())
                self._keep_apart(other.rollers, robot.skeleton.getBodyNodes())
            self._keep_apart(self._planes, robot.skeleton.getBodyNodes())
            self._robots.append(robot)

    def remove(self, robot: RobotBodies) -> None:
        """Remove a robot."""
        self.simulation.removeSkeleton(robot.skeleton)

    def add_planes(self, skeleton: Any) -> None:
        """Add planes, which touch nothing until they are allowed to."""
        self.simulation.addSkeleton(skeleton)
        planes = skeleton.getBodyNodes()
        if not any(planes[0] is plane for plane in self._planes):
            everybody = [robot.skeleton for robot in self._robots] + [*self.people.values()]
            for one in everybody:
                self._keep_apart(planes, one.getBodyNodes())
            self._planes += planes

    def remove_planes(self, skeleton: Any) -> None:
        """Remove planes."""
        self.simulation.removeSkeleton(skeleton)

    def allow(self, body: Any, other: Any) -> None:
        """Let a plane and a roller touch."""
        collisions = self._solver.getCollisionOption().collisionFilter
        collisions.removeBodyNodePairFromBlackList(body, other)

    def forbid(self, body: Any, other: Any) -> None:
        """Let a plane and a roller touch no more."""
        self._keep_apart([body], [other])

    def turn(self, heading: float) -> None:
        """Turn DART's axes to `heading` from the world's [rad]; what is in it stays as it is."""
        self.heading = heading
        slope, uphill = self._slope
        along, uphill = -bodies.GRAVITY * math.sin(slope), uphill - heading
        self.simulation.setGravity(
            [
                along * math.cos(uphill),
                along * math.sin(uphill),
                -bodies.GRAVITY * math.cos(slope),
            ]
        )

    def use_exact_friction(self, *, exact: bool) -> None:
        """Solve for Coulomb's cone from now on, or for the box."""
        if exact != self.is_exact:
            self.is_exact = exact
            self._solver.setBoxedLcpSolver(self._of_cone if exact else self._of_box)

    def slips(self) -> bool:
        """Return whether a force of the ground in the last step is at the cone's border or beyond.

        Rims have no friction, so only a base that scrapes along something else is not looked at.
        """
        contacts = self.simulation.getLastCollisionResult().getContacts()
        if self._has_ridges:
            return any(self._is_at_border(contact) for contact in contacts)
        forces = (c.force.tolist() for c in contacts if abs(c.normal[2]) >= UPRIGHT)
        return any(math.hypot(x, y) > 0.99 * self._friction * abs(z) for x, y, z in forces)

    def _is_at_border(self, contact: Any) -> bool:
        """Return whether a contact's force is at its cone's border or beyond."""
        force, normal = np.array(contact.force), np.array(contact.normal)
        along = float(np.sum(force * normal))
        friction = math.hypot(*(force - along * normal))
        return friction > 0.99 * self._friction * abs(along)

    def touches_more_than_the_ground(self) -> bool:
        """Return whether in the last step a robot touched an obstacle, a person or another."""
        contacts = self.simulation.getLastCollisionResult().getContacts()
        return any(abs(contact.normal[2]) < UPRIGHT for contact in contacts)

    def set_present(self, people: Mapping[int, MovingPerson]) -> None:
        """Set the people that are present, by their numbers; all others are removed.

        People that stay are not moved: DART integrates their velocity.
        """
        if people.keys() == self._present:
            return
        for number in self._present - people.keys():
            self.simulation.removeSkeleton(self.people[number])
        for number in sorted(people.keys() - self._present):
            if number not in self.people:
                self._build_person(number, has_legs=people[number].legs is not None)
            self.simulation.addSkeleton(self.people[number])
            place(self.people[number], people[number])
        self._present = set(people)

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Move a person, if they are present."""
        if number in self._present:
            place(self.people[number], person)

    def check_detector(self, robot: Any) -> None:
        """Press a robot's skeleton a little into the ground: its four rollers must feel it.

        The DART detector knows no contact of such a shape, FCL puts a sphere in its place;
        both without an error.

        Raises:
            UnsupportedError: if the contacts are others.
        """
        detector = self.simulation.getCollisionDetector()
        group = detector.createCollisionGroup()
        group.addShapeFramesOf(self._surroundings.getBodyNode(0))
        group.addShapeFramesOf(robot)
        result = dart.collision.CollisionResult()
        root = robot.getRootJoint()
        placed = root.getPositions()
        root.setPositions(placed - [0.0, 0.0, 0.0, 0.0, 0.0, _PROBE_DEPTH])
        group.collide(self.simulation.getConstraintSolver().getCollisionOption(), result)
        root.setPositions(placed)
        depths = [contact.penetrationDepth for contact in result.getContacts()]
        expected = _PROBE_DEPTH + bodies.DEPTH_M
        wrong = [depth for depth in depths if abs(depth - expected) > 0.1 * expected]
        if wrong or len(depths) != len(WHEELS):
            raise UnsupportedError(
                f"dartpy's {type(detector).__name__} does not simulate the rollers' shape: four "
                f"of them {_PROBE_DEPTH} m deep in the ground have contacts of depth {depths} m"
            )

    def _build_person(self, number: int, *, has_legs: bool) -> None:
        build = bodies.build_legs if has_legs else bodies.build_person
        person = build(self._shape)
        person.setName(f"person_{number}")
        parts = person.getBodyNodes()
        # Neither the ground, nor an obstacle, nor another stops the person: they go where they
        # are told.
        surroundings = self._surroundings.getBodyNodes()
        others = [body for other in self.people.values() for body in other.getBodyNodes()]
        rollers = [roller for robot in self._robots for roller in robot.rollers]
        self._keep_apart(parts, [*surroundings, *others, *rollers, *self._planes])
        self._keep_apart(parts, parts)
        self.people[number] = person

    def _keep_apart(self, bodies: Sequence[Any], others: Sequence[Any]) -> None:
        """Let none of the `bodies` touch any of the `others`."""
        collisions = self._solver.getCollisionOption().collisionFilter
        for body, other in product(bodies, others):
            collisions.addBodyNodePairToBlackList(body, other)
