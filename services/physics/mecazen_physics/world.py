"""The robot, the ground, the obstacles and the person in DART."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies, model
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import DivergedError
from mecazen_physics.pid import WheelPid
from mecazen_physics.plant import Plant

Vector = tuple[float, float, float]


Range = tuple[float, float]

_LONGEST_S = 0.02
"""Farther ahead the wheels' speeds cannot be foretold."""


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
        self._longest = max(1, round(_LONGEST_S / config.dt_s))
        self._hub_inertia = model.links(robot)[0].moments[1]
        self._plant = Plant(robot, config, start)
        self.joint_names = self._plant.joint_names
        self._pids = [WheelPid(config.pid, self._max_torque, config.dt_s) for _ in WHEELS]
        self._servo = config.drive == "velocity"
        self._effort = [0.0] * len(WHEELS)
        self._steps = 0
        self._state = self._read()

    def advance(self, command: Sequence[float], steps: int) -> None:
        """Simulate `steps` steps of `dt_s` towards the wheel speeds `command` [rad/s].

        Speeds beyond the motor's limit are taken as the limit.

        Raises:
            DivergedError: if the state is no longer one of a robot on the ground.
        """
        limit = self._max_speed
        target = [min(max(speed, -limit), limit) for speed in command]
        drive = self._drive_servo if self._config.drive == "velocity" else self._drive_pid

        def expect(speeds: Sequence[float], duration: float) -> list[Range]:
            del duration
            return [(min(pair), max(pair)) for pair in zip(speeds, target, strict=True)]

        self._advance(steps, expect, lambda chunk: drive(target, chunk))

    def advance_effort(self, command: Sequence[float], steps: int) -> None:
        """Simulate `steps` steps of `dt_s` with the wheel torques `command` [N·m].

        Torques beyond the motor's limit are taken as the limit, and a wheel at its highest
        speed is not driven further.

        Raises:
            DivergedError: if the state is no longer one of a robot on the ground.
        """

        def expect(speeds: Sequence[float], duration: float) -> list[Range]:
            gain = duration / self._hub_inertia
            changes = [gain * min(abs(torque), self._max_torque) for torque in command]
            return [(s - change, s + change) for s, change in zip(speeds, changes, strict=True)]

        self._advance(steps, expect, lambda chunk: self._drive_effort(command, chunk))

    def place_person(self, pose: Pose2D, velocity: Twist2D) -> None:
        """Put the person at `pose` in the world frame, moving with `velocity` in their own.

        They keep that velocity until placed again. A world has no person before the first
        call.
        """
        self._plant.place_person(pose, velocity)

    def state(self) -> WorldState:
        """Return the present state."""
        return self._state

    def _advance(
        self,
        steps: int,
        expect: Callable[[Sequence[float], float], list[Range]],
        drive: Callable[[int], None],
    ) -> None:
        """Simulate `steps` steps in chunks.

        Args:
            steps: Of `dt_s`.
            expect: Returns within what the wheels' speeds will stay that are now `speeds`, for
                a duration [rad/s, s].
            drive: Simulates some steps.
        """
        plant, dt = self._plant, self._config.dt_s
        left = steps
        while left > 0:
            x, y, _ = self._state.position
            qx, qy, _, _ = self._state.orientation
            plant.look_round(x, y, tilt=2.0 * math.asin(min(1.0, math.hypot(qx, qy))))
            chunk = min(left, self._longest)
            chunk = plant.prepare(expect(plant.scene.speeds(), chunk * dt), chunk)
            drive(chunk)
            plant.settle(chunk)
            self._steps += chunk
            self._update()
            left -= chunk

    def _drive_servo(self, target: Sequence[float], steps: int) -> None:
        self._use_servo(servo=True)
        scene = self._plant.scene
        for wheel, speed in zip(scene.wheels, target, strict=True):
            wheel.setCommand(0, speed)
        step = scene.step
        for _ in range(steps):
            step(False)

    def _drive_pid(self, target: Sequence[float], steps: int) -> None:
        self._use_servo(servo=False)
        wheels = self._plant.scene.wheels
        for _ in range(steps):
            speeds = [wheel.getVelocity(0) for wheel in wheels]
            self._step_effort(
                [
                    pid.update(goal - speed)
                    for pid, goal, speed in zip(self._pids, target, speeds, strict=True)
                ],
                speeds,
            )

    def _drive_effort(self, command: Sequence[float], steps: int) -> None:
        self._use_servo(servo=False)
        wheels = self._plant.scene.wheels
        for _ in range(steps):
            self._step_effort(command, [wheel.getVelocity(0) for wheel in wheels])

    def _step_effort(self, command: Sequence[float], speeds: list[float]) -> None:
        scene = self._plant.scene
        limit, fastest = self._max_torque, self._max_speed
        for index, (torque, speed) in enumerate(zip(command, speeds, strict=True)):
            upper = limit if speed < fastest else 0.0
            lower = -limit if speed > -fastest else 0.0
            self._effort[index] = min(max(torque, lower), upper)
            scene.wheels[index].setCommand(0, self._effort[index])
        scene.step(False)

    def _use_servo(self, *, servo: bool) -> None:
        self._plant.scene.use_servo(servo=servo)
        if servo != self._servo:
            self._servo = servo
            for pid in self._pids:
                pid.reset()

    def _wheel_efforts(self) -> list[float]:
        if not self._servo:
            return list(self._effort)
        # DART's servo is a velocity constraint; its torque is that constraint's impulse.
        dt = self._config.dt_s
        return [wheel.getConstraintImpulse(0) / dt for wheel in self._plant.scene.wheels]

    def _read(self) -> WorldState:
        """Return the state that DART is in."""
        motion = self._plant.scene.read()
        orientation = _quaternion(*motion.base_position[:3])
        x, y, z = motion.base_position[3:6]
        bearing = self._bearing_friction
        rollers = [-bearing * rate for rate in motion.joint_velocity[len(WHEELS) :]]
        return WorldState(
            time=self._steps * self._config.dt_s,
            position=(x, y, z),
            orientation=orientation,
            linear=_unrotate(orientation, *motion.base_velocity[3:6]),
            angular=_unrotate(orientation, *motion.base_velocity[:3]),
            joint_position=motion.joint_position,
            joint_velocity=motion.joint_velocity,
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
