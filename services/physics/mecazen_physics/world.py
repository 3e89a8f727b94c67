"""The robot, the ground, the obstacles and the person in DART."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import dartpy as dart
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import DivergedError, UnsupportedError
from mecazen_physics.pid import WheelPid
from mecazen_physics.reach import Circle, Reach

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""

Vector = tuple[float, float, float]

_BASE_DOFS = 6
_PROBE_DEPTH = 1e-4


class WorldState(NamedTuple):
    """The robot at one instant.

    `position` (3,) [m] and `orientation`, a quaternion (x, y, z, w), place base_link in the
    world frame. `linear` (3,) [m/s] and `angular` (3,) [rad/s] are the velocity of
    base_link's origin relative to the world, in the axes of base_link. The joints' lists go
    with `World.joint_names`: [rad], not wrapped, [rad/s], and [N·m]: what the motor of a
    wheel applied in the last step, and the bearing's friction on a roller.
    """

    time: float
    position: Vector
    orientation: tuple[float, float, float, float]
    linear: Vector
    angular: Vector
    joint_position: list[float]
    joint_velocity: list[float]
    joint_effort: list[float]


class World:
    """A robot at rest at `start`, and what surrounds it.

    Two worlds built from the same arguments and advanced alike have the same states to the
    last bit.

    Raises:
        UnsupportedError: if dartpy does not simulate the rollers' shape, an obstacle is so low
            that the robot could drive onto it, or a roller's bearing too stiff for the step.
    """

    def __init__(self, robot: Robot, config: PhysicsConfig, start: Pose2D) -> None:
        bodies.check_bearings(robot, config)
        self._config = config
        self._max_torque = robot.wheels.max_torque_nm
        self._max_speed = robot.wheels.max_speed_rad_s
        self._deepest = robot.rollers.max_radius_m
        # DART puts a body whose pose is not a number to the origin. Nothing that a robot meets
        # makes it ten times as fast as its motors can.
        self._fastest = 10.0 * robot.wheels.max_speed_rad_s * robot.wheels.radius_m
        self._bearing_friction = robot.rollers.bearing_friction_nms
        self._world = dart.simulation.World()
        self._world.setTimeStep(config.dt_s)
        self._world.setGravity(_gravity(config))
        self._world.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self._world.getDeactivationOptions()
        sleep.mEnabled = False
        self._world.setDeactivationOptions(sleep)
        self._surroundings = bodies.build_surroundings(robot, config)
        self._robot, joints = bodies.build_robot(robot, config, start)
        self._wheels = joints[: len(WHEELS)]
        self.joint_names: tuple[str, ...] = tuple(joint.getName() for joint in joints)
        self._reach = Reach(robot, [joint.getChildBodyNode() for joint in joints[len(WHEELS) :]])
        self._obstacles = [
            Circle(*obstacle.position_m, math.hypot(*obstacle.size_m[:-1]))
            for obstacle in config.obstacles
        ]
        self._person: Any = None
        self._person_circle: list[Circle] = []
        self._world.addSkeleton(self._surroundings)
        self._world.addSkeleton(self._robot)
        self._pids = [WheelPid(config.pid, self._max_torque, config.dt_s) for _ in WHEELS]
        self._servo: bool | None = None
        self._effort = [0.0] * len(WHEELS)
        self._steps = 0
        self._use_servo(servo=config.drive == "velocity")
        self._check_supported()
        self._state = self._read()

    def advance(self, command: Sequence[float], steps: int) -> None:
        """Simulate `steps` steps of `dt_s` towards the wheel speeds `command` [rad/s].

        Speeds beyond the motor's limit are taken as the limit.

        Raises:
            DivergedError: if the state is no longer one of a robot on the ground.
        """
        limit = self._max_speed
        target = [min(max(speed, -limit), limit) for speed in command]
        self._choose_rollers(target, steps)
        if self._config.drive == "effort":
            self._advance_pid(target, steps)
        else:
            self._advance_servo(target, steps)
        self._update()

    def advance_effort(self, command: Sequence[float], steps: int) -> None:
        """Simulate `steps` steps of `dt_s` with the wheel torques `command` [N·m].

        Torques beyond the motor's limit are taken as the limit, and a wheel at its highest
        speed is not driven further.

        Raises:
            DivergedError: if the state is no longer one of a robot on the ground.
        """
        self._use_servo(servo=False)
        self._choose_rollers([self._max_speed] * len(WHEELS), steps)
        for _ in range(steps):
            self._step_effort(command, [wheel.getVelocity(0) for wheel in self._wheels])
        self._update()

    def place_person(self, pose: Pose2D, velocity: Twist2D) -> None:
        """Put the person at `pose` in the world frame, moving with `velocity` in their own.

        They keep that velocity until placed again. A world has no person before the first
        call.
        """
        if self._person is None:
            self._person = self._add_person()
        self._person_circle = [Circle(pose.x, pose.y, self._config.person.radius_m)]
        self._person.setPositions([pose.x, pose.y])
        self._person.setCommands(list(rotate(velocity.x, velocity.y, pose.yaw)))

    def state(self) -> WorldState:
        """Return the present state."""
        return self._state

    def _choose_rollers(self, target: list[float], steps: int) -> None:
        """Leave the rollers that can touch nothing in these steps out of the collisions."""
        state = self._state
        speeds = state.joint_velocity[: len(WHEELS)]
        x, y, _, _ = state.orientation
        self._reach.update(
            angles=state.joint_position[: len(WHEELS)],
            fastest=[max(abs(a), abs(b)) for a, b in zip(speeds, target, strict=True)],
            duration=steps * self._config.dt_s,
            tilt=2.0 * math.asin(min(1.0, math.hypot(x, y))),
            others=self._obstacles + self._person_circle,
            position=state.position,
        )

    def _advance_servo(self, target: list[float], steps: int) -> None:
        self._use_servo(servo=True)
        for wheel, speed in zip(self._wheels, target, strict=True):
            wheel.setCommand(0, speed)
        step = self._world.step
        for _ in range(steps):
            step(False)
        self._steps += steps

    def _advance_pid(self, target: list[float], steps: int) -> None:
        self._use_servo(servo=False)
        for _ in range(steps):
            speeds = [wheel.getVelocity(0) for wheel in self._wheels]
            self._step_effort(
                [
                    pid.update(goal - speed)
                    for pid, goal, speed in zip(self._pids, target, speeds, strict=True)
                ],
                speeds,
            )

    def _step_effort(self, command: Sequence[float], speeds: list[float]) -> None:
        limit, fastest = self._max_torque, self._max_speed
        for index, (torque, speed) in enumerate(zip(command, speeds, strict=True)):
            upper = limit if speed < fastest else 0.0
            lower = -limit if speed > -fastest else 0.0
            self._effort[index] = min(max(torque, lower), upper)
            self._wheels[index].setCommand(0, self._effort[index])
        self._world.step(False)
        self._steps += 1

    def _use_servo(self, *, servo: bool) -> None:
        if servo == self._servo:
            return
        self._servo = servo
        for wheel, pid in zip(self._wheels, self._pids, strict=True):
            wheel.setActuatorType(dart.dynamics.SERVO if servo else dart.dynamics.FORCE)
            pid.reset()

    def _wheel_efforts(self) -> list[float]:
        if not self._servo:
            return list(self._effort)
        # DART's servo is a velocity constraint; its torque is that constraint's impulse.
        dt = self._config.dt_s
        return [wheel.getConstraintImpulse(0) / dt for wheel in self._wheels]

    def _add_person(self) -> Any:
        person, body = bodies.build_person(self._config.person)
        # Neither the ground nor an obstacle stops the person: they go where they are told.
        collisions = self._world.getConstraintSolver().getCollisionOption().collisionFilter
        for index in range(self._surroundings.getNumBodyNodes()):
            collisions.addBodyNodePairToBlackList(body, self._surroundings.getBodyNode(index))
        self._world.addSkeleton(person)
        return person

    def _check_supported(self) -> None:
        """Press the robot a little into the ground and see that its four rollers feel it.

        The DART detector knows no contact of such a shape, FCL puts a sphere in its place;
        both without an error.
        """
        detector = self._world.getCollisionDetector()
        group = detector.createCollisionGroup()
        group.addShapeFramesOf(self._surroundings.getBodyNode(0))
        group.addShapeFramesOf(self._robot)
        result = dart.collision.CollisionResult()
        root = self._robot.getRootJoint()
        placed = root.getPositions()
        root.setPositions(placed - [0.0, 0.0, 0.0, 0.0, 0.0, _PROBE_DEPTH])
        group.collide(self._world.getConstraintSolver().getCollisionOption(), result)
        root.setPositions(placed)
        depths = [contact.penetrationDepth for contact in result.getContacts()]
        wrong = [depth for depth in depths if abs(depth - _PROBE_DEPTH) > 0.1 * _PROBE_DEPTH]
        if wrong or len(depths) != len(WHEELS):
            raise UnsupportedError(
                f"dartpy's {type(detector).__name__} does not simulate the rollers' shape: four "
                f"of them {_PROBE_DEPTH} m deep in the ground have contacts of depth {depths} m"
            )

    def _read(self) -> WorldState:
        """Return the state that DART is in; its free joint's velocity is in world axes."""
        position = self._robot.getPositions().tolist()
        velocity = self._robot.getVelocities().tolist()
        orientation = _quaternion(*position[:3])
        bearing = self._bearing_friction
        rollers = [-bearing * rate for rate in velocity[_BASE_DOFS + len(WHEELS) :]]
        return WorldState(
            time=self._steps * self._config.dt_s,
            position=(position[3], position[4], position[5]),
            orientation=orientation,
            linear=_unrotate(orientation, *velocity[3:_BASE_DOFS]),
            angular=_unrotate(orientation, *velocity[:3]),
            joint_position=position[_BASE_DOFS:],
            joint_velocity=velocity[_BASE_DOFS:],
            joint_effort=self._wheel_efforts() + rollers,
        )

    def _update(self) -> None:
        """Take over the state that DART is in, if it makes sense."""
        state = self._read()
        everything = sum(state.joint_position) + sum(state.joint_velocity)
        everything += sum(state.position) + sum(state.linear) + sum(state.angular)
        moved = math.dist(state.position, self._state.position)
        duration = state.time - self._state.time
        reason = None
        if not math.isfinite(everything):
            reason = "its numbers are not finite"
        # The base's origin is the mean of the wheels' lowest points, which no attitude of a
        # robot above the ground brings below it.
        elif state.position[2] < -self._deepest:
            reason = f"the robot is {-state.position[2]:.3g} m below the ground"
        elif moved > self._fastest * duration:
            reason = f"the robot moved {moved:.3g} m in {duration:.3g} s"
        if reason:
            good = self._state
            raise DivergedError(
                f"physics diverged before {state.time:.3f} s: {reason}; last good state at "
                f"{good.time:.3f} s: position {good.position} m, orientation "
                f"{good.orientation}, velocity {good.linear} m/s, {good.angular} rad/s, "
                f"wheels {good.joint_velocity[: len(WHEELS)]} rad/s"
            )
        self._state = state


def _gravity(config: PhysicsConfig) -> list[float]:
    slope, heading = math.radians(config.slope_deg), math.radians(config.slope_heading_deg)
    along = -GRAVITY * math.sin(slope)
    return [along * math.cos(heading), along * math.sin(heading), -GRAVITY * math.cos(slope)]


def _quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of a rotation vector [rad]."""
    angle = math.hypot(x, y, z)
    scale = math.sin(angle / 2) / angle if angle > 0.0 else 0.5
    return scale * x, scale * y, scale * z, math.cos(angle / 2)


def _unrotate(q: tuple[float, float, float, float], x: float, y: float, z: float) -> Vector:
    """Return the vector (x, y, z) in the axes of the frame that is turned by `q`."""
    qx, qy, qz, w = q
    # v + 2·p×(p×v + w·v) for the inverse turn, whose quaternion is (p, w) with p = -(qx, qy, qz).
    cx = qz * y - qy * z + w * x
    cy = qx * z - qz * x + w * y
    cz = qy * x - qx * y + w * z
    return (
        x + 2.0 * (qz * cy - qy * cz),
        y + 2.0 * (qx * cz - qz * cx),
        z + 2.0 * (qy * cx - qx * cy),
    )
