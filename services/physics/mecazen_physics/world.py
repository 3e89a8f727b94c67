"""The world in DART: ground, obstacles and people, and which bodies collide."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any, Literal

import dartpy as dart
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.config.world import Box, Cylinder, Patch, PersonConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.robot import Robot

from mecazen_physics.people import LEGS, MovingPerson, place

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""
SOLID_FRICTION, PERSON_FRICTION = 1.0, 0.5
"""Coulomb coefficients between the robot and obstacles or persons."""
DEPTH_M = 1e-5
"""Depth of the wheels in DART's ground [m]; the ground is raised above z = 0 by the same depth.

Hulls of 81 spheres are up to 0.4 µm out of round. At this depth every wheel that stands has a
contact."""
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
plane collides with one roller, which is set by `DartWorld.allow`. Persons collide only with robots.
"""


class UnsupportedError(ConfigError):
    """Physics cannot simulate what the scenario specifies."""


class DartWorld:
    """The ground, with one robot, or several robots that are close to each other.

    People and obstacles are in the world while they are close. `step(False)` simulates a step of
    `dt_s`.

    DART's default solver limits friction by a box along two horizontal axes, not by Coulomb's cone:
    between these axes a force can be √2 too large. A roller resists only along its own axis, so the
    box is exact if its axes are those of the rollers. For rollers at 45°, DART's axes are turned
    with a robot that is alone. In all other cases DART solves for the cone while any contact is
    about to slip, which takes up to five times as long.
    """

    def __init__(self, robot: Robot, physics: PhysicsConfig, world: WorldConfig) -> None:
        self._robot, self._config = robot, world
        self._slope = math.radians(world.slope_deg), math.radians(world.slope_heading_deg)
        self._friction = min(ground_frictions(robot, world))
        self.dart = dart.simulation.World()
        self.dart.setTimeStep(physics.dt_s)
        self._alignable = robot.rollers.angle_deg == 45.0
        self.turn(0.0)
        self._solver = self.dart.getConstraintSolver()
        self._box = self._solver.getBoxedLcpSolver()
        self._cone = dart.constraint.NsgsFrictionSolver()
        self._solves_cone = False
        """Whether friction is limited by Coulomb's cone, not by the box."""
        # Only Bullet finds the contacts of rollers. DART's own detector finds none, and FCL and ODE
        # replace a roller by a sphere.
        self.dart.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self.dart.getDeactivationOptions()
        sleep.mEnabled = False
        self.dart.setDeactivationOptions(sleep)
        self._known: list[Any] = []
        """The skeletons that have been in the world."""
        self._layers: dict[Layer, list[Any]] = {}
        """The bodies of the known skeletons, by layer."""
        self._hidden: dict[Any, None] = {}
        """The shapes that collide with nothing for now, in the order in which they were hidden."""
        self.people: dict[int, Any] = {}
        """The skeletons of all people that have been present, by number."""
        self._present: set[int] = set()
        self._has_obstacles = False
        ground = _build_ground(robot, world)
        self.add(ground, {"ground": ground.getBodyNodes()})
        self.step = self.dart.step

    @cached_property
    def _obstacles(self) -> Any:
        return _build_obstacles(reachable(self._robot, self._config))

    def change(self, world: WorldConfig) -> None:
        """Replace the obstacles by those of a changed world."""
        if self._has_obstacles:
            self._has_obstacles = False
            self.remove(self._obstacles)
        vars(self).pop("_obstacles", None)  # built again when a robot is near
        self._config = world

    def add(self, skeleton: Any, layers: Layers) -> None:
        """Add a skeleton, whose bodies collide with those of the layers in `_TOUCHING`."""
        self.dart.addSkeleton(skeleton)
        if any(skeleton is known for known in self._known):
            return
        self._known.append(skeleton)
        for layer, bodies in layers.items():
            for present, present_bodies in self._layers.items():
                if frozenset((layer, present)) not in _TOUCHING:
                    self.keep_apart(bodies, present_bodies)
            self._layers.setdefault(layer, []).extend(bodies)

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
        group = self._solver.getCollisionGroup()
        for shape in self._hidden:
            group.removeShapeFrame(shape)

    def hide(self, shapes: Iterable[Any]) -> None:
        """Let shapes collide with nothing, which saves DART the search for their contacts."""
        group = self._solver.getCollisionGroup()
        for shape in shapes:
            if shape not in self._hidden:
                self._hidden[shape] = None
                group.removeShapeFrame(shape)

    def show(self, shapes: Iterable[Any]) -> None:
        """Let hidden shapes collide again."""
        group = self._solver.getCollisionGroup()
        for shape in shapes:
            if shape in self._hidden:
                del self._hidden[shape]
                group.addShapeFrame(shape)

    def show_all(self) -> None:
        """Let all hidden shapes collide again."""
        self._hidden.clear()
        self.renew_detector()

    def keep_apart(self, bodies: Sequence[Any], others: Sequence[Any]) -> None:
        """Disable collisions between `bodies` and `others`."""
        collisions = self._solver.getCollisionOption().collisionFilter
        for pair in product(bodies, others):
            collisions.addBodyNodePairToBlackList(*pair)

    def allow(self, plane: Any, roller: Any) -> None:
        """Let a plane and a roller collide."""
        collisions = self._solver.getCollisionOption().collisionFilter
        collisions.removeBodyNodePairFromBlackList(plane, roller)

    def set_surroundings(self, people: Mapping[int, MovingPerson], *, obstacles: bool) -> None:
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
                legs = people[number].legs
                self.people[number] = build_legs() if legs else _build_cylinder(self._config.person)
            self.add(self.people[number], {"person": self.people[number].getBodyNodes()})
            place(self.people[number], people[number])
        self._present = set(people)

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Move a person who is present in the world."""
        if number in self._present:
            place(self.people[number], person)

    def turn(self, heading: float) -> None:
        """Turn DART's axes to `heading` from the world's [rad]; bodies are not changed."""
        self.heading = heading
        slope, uphill = self._slope
        along, uphill = -GRAVITY * math.sin(slope), uphill - heading
        down = -GRAVITY * math.cos(slope)
        self.dart.setGravity([along * math.cos(uphill), along * math.sin(uphill), down])

    def alignment(self, yaw: float) -> float | None:
        """Return the angle from DART's axes to the rollers' of a robot at `yaw`, at most 45° [rad].

        The result is None if rollers are not at right angles to each other.
        """
        if not self._alignable:
            return None
        return math.remainder(yaw - math.pi / 4.0 - self.heading, math.pi / 2.0)

    def choose_solver(self, *, alone: bool, robots: int) -> None:
        """Choose the cone solver if a contact is about to slip, otherwise the box solver.

        Only the ground can touch a robot that is `alone`.
        """
        cone = not (alone and self._alignable) and self._may_slip()
        if cone:
            options = self._cone.getOptions()
            options.tolerance = CONE_TOLERANCE
            options.maxSweeps = MAX_SWEEPS if robots == 1 else MAX_SWEEPS_OF_SEVERAL
            self._cone.setOptions(options)
        if cone != self._solves_cone:
            self._solves_cone = cone
            self._solver.setBoxedLcpSolver(self._cone if cone else self._box)

    def _may_slip(self) -> bool:
        """Return whether any ground force in the last step was near the friction cone.

        Contacts of a base that scrapes along an obstacle are ignored. Rims have no friction.
        """
        for contact in self.dart.getLastCollisionResult().getContacts():
            nx, ny, nz = contact.normal.tolist()
            if abs(nz) >= UPRIGHT or self._config.ridges:
                x, y, z = contact.force.tolist()
                along = x * nx + y * ny + z * nz
                friction = math.hypot(x - along * nx, y - along * ny, z - along * nz)
                if friction > SLIP_SHARE * self._friction * abs(along):
                    return True
        return False


def ground_friction(robot: Robot, ground: WorldConfig | Patch) -> float:
    """Return the friction coefficient between the rollers and the ground, or a patch of it."""
    surface = ground.friction if isinstance(ground, Patch) else ground.ground_friction
    return surface * robot.rollers.contact_friction


def ground_frictions(robot: Robot, world: WorldConfig) -> list[float]:
    """Return the friction coefficients between the rollers and the ground with its patches."""
    patches = [ground_friction(robot, patch) for patch in world.patches]
    return [ground_friction(robot, world), *patches]


def reachable(robot: Robot, world: WorldConfig) -> list[Box | Cylinder]:
    """Return the obstacles of the world, without those that the robot passes below.

    Raises:
        UnsupportedError: An obstacle is so low that the robot could drive onto it.
    """
    solids = [solid for solid in world.solids if solid.bottom_m < robot.height]
    for solid in solids:
        height = solid.size_m[-1]
        if solid.bottom_m == 0.0 and height < robot.wheels.radius_m:
            # On a face of a box the rollers' contacts jump; only contacts with a plane are smooth.
            raise UnsupportedError(
                f"an obstacle {height} m high is lower than the wheels' axles "
                f"({robot.wheels.radius_m} m): driving onto one cannot be simulated"
            )
    return solids


def _build_ground(robot: Robot, world: WorldConfig) -> Any:
    skeleton = dart.dynamics.Skeleton("ground")
    _, ground = skeleton.createWeldJointAndBodyNodePair()
    plane = dart.dynamics.PlaneShape([0.0, 0.0, 1.0], DEPTH_M)
    # On patches, `RobotBody.set_friction` sets the coefficient of the rollers.
    add_shape(ground, plane, max(ground_frictions(robot, world)))
    skeleton.setMobile(False)
    return skeleton


def _build_obstacles(solids: Sequence[Box | Cylinder]) -> Any:
    """Return the skeleton of all obstacles, a body with a shape for each.

    A body for each would take time that grows with the square of their number.
    """
    skeleton = dart.dynamics.Skeleton("obstacles")
    _, body = skeleton.createWeldJointAndBodyNodePair()
    for solid in solids:
        if isinstance(solid, Box):
            shape = dart.dynamics.BoxShape(list(solid.size_m))
            yaw = math.radians(solid.yaw_deg)
        else:
            shape = dart.dynamics.CylinderShape(*solid.size_m)
            yaw = 0.0
        pose = upright(Pose2D(*solid.position_m, yaw), solid.bottom_m + solid.size_m[-1] / 2)
        add_shape(body, shape, SOLID_FRICTION).setRelativeTransform(pose)
    skeleton.setMobile(False)
    return skeleton


def _build_cylinder(shape: PersonConfig) -> Any:
    """Return the skeleton of a person without joints, whose two positions are x and y [m].

    The joint moves at the commanded velocity, independent of contacts.
    """
    skeleton = dart.dynamics.Skeleton("person")
    joint, body = skeleton.createTranslationalJoint2DAndBodyNodePair()
    joint.setTransformFromParentBodyNode(upright(Pose2D(), shape.height_m / 2))
    joint.setActuatorType(dart.dynamics.VELOCITY)
    cylinder = dart.dynamics.CylinderShape(shape.radius_m, shape.height_m)
    add_shape(body, cylinder, PERSON_FRICTION)
    return skeleton


def build_legs() -> Any:
    """Return the skeleton of a person with joints: one body for each of `LEGS`.

    Each body has six positions: a rotation vector [rad] and the middle [m]. It moves at the
    commanded velocity, independent of contacts.
    """
    skeleton = dart.dynamics.Skeleton("person")
    for _ in LEGS:
        joint, body = skeleton.createFreeJointAndBodyNodePair()
        joint.setActuatorType(dart.dynamics.VELOCITY)
        add_shape(body, dart.dynamics.CapsuleShape(0.1, 0.1), PERSON_FRICTION)
    return skeleton


def add_shape(
    body: Any, shape: Any, friction: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Any:
    """Add a colliding shape to a body, at `offset` [m]; return its node."""
    node = body.createShapeNode(shape)
    node.setRelativeTranslation(offset)
    node.createCollisionAspect()
    node.createDynamicsAspect().setFrictionCoeff(friction)
    return node


def upright(pose: Pose2D, z: float) -> Any:
    """Return DART's transform of an upright body at `pose`, `z` [m] above the ground."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    rotation = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    return dart.math.Isometry3(rotation, [pose.x, pose.y, z])
