"""A world of DART: the ground, the obstacles, and the people who are close to its robots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import dartpy as dart
from mecazen.robot import WHEELS, Robot
from mecazen.world import WorldConfig

from mecazen_physics import bodies
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import UnsupportedError

_PROBE_DEPTH = 1e-4


class MovingPerson(NamedTuple):
    """A person's position [m] and velocity (2,) [m/s] in the world frame."""

    x: float
    y: float
    velocity: tuple[float, float]


class DartWorld:
    """A world of DART that robots of the rollers of `robot` stand in.

    `step(False)` simulates a step of `dt_s`.

    Raises:
        UnsupportedError: if an obstacle is so low that `robot` could drive onto it.
    """

    def __init__(self, robot: Robot, physics: PhysicsConfig, world: WorldConfig) -> None:
        self._shape = world.person
        self.simulation = dart.simulation.World()
        self.simulation.setTimeStep(physics.dt_s)
        self.simulation.setGravity(_gravity(world))
        self.simulation.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self.simulation.getDeactivationOptions()
        sleep.mEnabled = False
        self.simulation.setDeactivationOptions(sleep)
        self._surroundings = bodies.build_surroundings(robot, world)
        self.simulation.addSkeleton(self._surroundings)
        self.step = self.simulation.step
        self.people: dict[int, Any] = {}
        """The skeletons of all who have ever been present, by their numbers."""
        self._present: set[int] = set()

    def set_present(self, people: Mapping[int, MovingPerson]) -> None:
        """Have these people present, by their numbers, and nobody else.

        Those who stay are not moved: DART integrates their velocity.
        """
        if people.keys() == self._present:
            return
        for number in self._present - people.keys():
            self.simulation.removeSkeleton(self.people[number])
        for number in sorted(people.keys() - self._present):
            if number not in self.people:
                self._build_person(number)
            self.simulation.addSkeleton(self.people[number])
            self._place(number, people[number])
        self._present = set(people)

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Move a person, if they are present."""
        if number in self._present:
            self._place(number, person)

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
        wrong = [depth for depth in depths if abs(depth - _PROBE_DEPTH) > 0.1 * _PROBE_DEPTH]
        if wrong or len(depths) != len(WHEELS):
            raise UnsupportedError(
                f"dartpy's {type(detector).__name__} does not simulate the rollers' shape: four "
                f"of them {_PROBE_DEPTH} m deep in the ground have contacts of depth {depths} m"
            )

    def _place(self, number: int, person: MovingPerson) -> None:
        skeleton = self.people[number]
        skeleton.setPositions([person.x, person.y])
        skeleton.setCommands(person.velocity)

    def _build_person(self, number: int) -> None:
        person = bodies.build_person(self._shape)
        person.setName(f"person_{number}")
        body = person.getBodyNode(0)
        # Neither the ground, nor an obstacle, nor another stops the person: they go where they
        # are told.
        collisions = self.simulation.getConstraintSolver().getCollisionOption().collisionFilter
        for index in range(self._surroundings.getNumBodyNodes()):
            collisions.addBodyNodePairToBlackList(body, self._surroundings.getBodyNode(index))
        for other in self.people.values():
            collisions.addBodyNodePairToBlackList(body, other.getBodyNode(0))
        self.people[number] = person


def _gravity(world: WorldConfig) -> list[float]:
    slope, heading = math.radians(world.slope_deg), math.radians(world.slope_heading_deg)
    along = -bodies.GRAVITY * math.sin(slope)
    return [along * math.cos(heading), along * math.sin(heading), -bodies.GRAVITY * math.cos(slope)]
