"""The robot, the ground, the obstacles and the person in DART."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies, model
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import DivergedError
from mecazen_physics.pid import WheelPid
from mecazen_physics.plant import Plant
from mecazen_physics.reach import LONGEST_S, Footprint, Outline
from mecazen_physics.scene import Drive, Stage, Walking

Vector = tuple[float, float, float]

AT_EASE = 0.8
"""Motors that are asked for less than this share of their torque need no limit."""


class WheelCommand(NamedTuple):
    """What the motors are to do: speeds [rad/s], or efforts [N·m], in the order of `WHEELS`."""

    values: Sequence[float]
    is_effort: bool = False


def longest_chunk(config: PhysicsConfig) -> int:
    """Return how many steps are simulated at most before robots look round again."""
    return max(1, round(LONGEST_S / config.dt_s))


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
    """A robot at rest at `start`, and what surrounds it; other robots are in the `Arena`.

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
        self.fastest = 10.0 * robot.wheels.max_speed_rad_s * robot.wheels.radius_m
        """A robot that is faster [m/s] has diverged."""
        self._bearing_friction = robot.rollers.bearing_friction_nms
        self._longest = longest_chunk(config)
        self._hub_inertia = model.links(robot)[0].moments[1]
        self._kick_nms = model.driven_inertia(robot) / config.dt_s
        """What a motor gives for each rad/s by which its wheel's speed changes in one step."""
        self._outline = Outline(robot)
        self._plant = Plant(robot, config, start)
        self.joint_names = self._plant.joint_names
        self._pids = [WheelPid(config.pid, self._max_torque, config.dt_s) for _ in WHEELS]
        self._by_torque = config.drive == "effort"
        self._steps = 0
        self._state = self._read()
        self._torque = math.inf
        """The most that a motor gave in the last step; at first it may have to give anything."""

    def advance(self, command: Sequence[float], steps: int) -> None:
        """Simulate `steps` steps of `dt_s` towards the wheel speeds `command` [rad/s].

        Speeds beyond the motor's limit are taken as the limit.

        Raises:
            DivergedError: if the state is no longer one of a robot on the ground.
        """
        advance_together([self], [WheelCommand(command)], steps)

    def advance_effort(self, command: Sequence[float], steps: int) -> None:
        """Simulate `steps` steps of `dt_s` with the wheel torques `command` [N·m].

        Torques beyond the motor's limit are taken as the limit, and a wheel at its highest
        speed is not driven further.

        Raises:
            DivergedError: if the state is no longer one of a robot on the ground.
        """
        advance_together([self], [WheelCommand(command, is_effort=True)], steps)

    def place_person(self, pose: Pose2D, velocity: Twist2D, number: int = 0) -> None:
        """Put a person at `pose` in the world frame, moving with `velocity` in their own.

        They keep that velocity until placed again. A world has no person of this number before
        the first call.
        """
        self._plant.place_person(pose, velocity, number)

    def share(self, stage: Stage | None) -> None:
        """See `Plant`."""
        self._plant.share(stage)

    def footprint(self) -> Footprint:
        """Return the robot from above."""
        state = self._state
        x, y, _ = state.position
        _, _, qz, qw = state.orientation
        speed = math.hypot(*state.linear[:2])
        return self._outline.at(Pose2D(x, y, 2.0 * math.atan2(qz, qw)), speed, state.angular[2])

    def state(self) -> WorldState:
        """Return the present state."""
        return self._state

    @property
    def stage(self) -> Stage:
        """Where the robot is now."""
        return self._plant.scene.stage

    @property
    def close_people(self) -> Mapping[int, Walking]:
        """Those who may touch the robot soon, by their numbers."""
        return self._plant.close_people

    def look_round(self) -> None:
        """See `Plant`."""
        qx, qy, _, _ = self._state.orientation
        tilt = 2.0 * math.asin(min(1.0, math.hypot(qx, qy)))
        self._plant.look_round(self.footprint(), tilt)

    def prepare(self, command: WheelCommand, steps: int) -> tuple[int, Callable[[], None] | None]:
        """Give the motors a command.

        Returns:
            How many of `steps` steps can be simulated before the next call, and what is to be
            done before each of them, if anything.
        """
        steps = min(steps, self._longest)
        speeds = self._state.joint_velocity[: len(WHEELS)]
        push: Callable[[], None] | None
        if command.is_effort:
            gain = steps * self._config.dt_s / self._hub_inertia
            changes = [gain * min(abs(torque), self._max_torque) for torque in command.values]
            expected = [(s - change, s + change) for s, change in zip(speeds, changes, strict=True)]
            self._use("torque")
            push = partial(self._push, command.values)
        else:
            limit = self._max_speed
            target = [min(max(speed, -limit), limit) for speed in command.values]
            expected = [
                (now, goal) if now < goal else (goal, now)
                for now, goal in zip(speeds, target, strict=True)
            ]
            push = self._aim(target, steps)
        return self._plant.prepare(expected, steps), push

    def _aim(self, target: Sequence[float], steps: int) -> Callable[[], None] | None:
        """Have the motors bring the wheels to `target` [rad/s]; see `prepare`."""
        if self._config.drive == "effort":
            self._use("torque")
            return partial(self._control, target)
        rise = self._rise(target) if self._plant.alone else math.inf
        self._use("speed" if rise <= steps else "servo")
        wheels = self._plant.scene.wheels
        if 1.0 < rise <= steps:
            return _ramp(wheels, self._state.joint_velocity, target, math.ceil(rise))
        for wheel, speed in zip(wheels, target, strict=True):
            wheel.setCommand(0, speed)
        return None

    def _rise(self, target: Sequence[float]) -> float:
        """Return in how many steps motors that stay at ease reach `target` [rad/s]."""
        left = AT_EASE * self._max_torque - self._torque
        if left <= 0.0:
            return math.inf
        speeds = self._state.joint_velocity
        change = max(abs(goal - speed) for goal, speed in zip(target, speeds, strict=False))
        return self._kick_nms * change / left

    def settle(self, steps: int) -> None:
        """Take over the state after `steps` steps that were simulated."""
        self._plant.settle(steps)
        self._steps += steps
        self._update()
        self._torque = max(map(abs, self._state.joint_effort[: len(WHEELS)]))

    def _control(self, target: Sequence[float]) -> None:
        """Set the torques that bring the wheels to the speeds `target` [rad/s]."""
        wheels = self._plant.scene.wheels
        torques = [
            pid.update(goal - wheel.getVelocity(0))
            for pid, goal, wheel in zip(self._pids, target, wheels, strict=True)
        ]
        self._push(torques)

    def _push(self, torques: Sequence[float]) -> None:
        """Set the wheels' torques [N·m], as far as motors give them at their speeds."""
        limit, fastest = self._max_torque, self._max_speed
        for wheel, torque in zip(self._plant.scene.wheels, torques, strict=True):
            speed = wheel.getVelocity(0)
            upper = limit if speed < fastest else 0.0
            lower = -limit if speed > -fastest else 0.0
            wheel.setCommand(0, min(max(torque, lower), upper))

    def _use(self, drive: Drive) -> None:
        self._plant.scene.use(drive)
        if self._by_torque != (drive == "torque"):
            self._by_torque = drive == "torque"
            for pid in self._pids:
                pid.reset()

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
            joint_effort=self._plant.scene.torques() + rollers,
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
        elif moved > self.fastest * duration:
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


def _ramp(
    wheels: Sequence[Any], speeds: Sequence[float], target: Sequence[float], steps: int
) -> Callable[[], None]:
    """Return what brings wheels from `speeds` to `target` [rad/s], step by step."""
    ways = list(zip(wheels, speeds, target, strict=False))
    parts = iter([(step + 1) / steps for step in range(steps)])

    def push() -> None:
        part = next(parts, None)
        if part is not None:
            for wheel, begin, end in ways:
                wheel.setCommand(0, begin + part * (end - begin))

    return push


def advance_together(worlds: Sequence[World], commands: Sequence[WheelCommand], steps: int) -> None:
    """Simulate `steps` steps of `dt_s` of one robot, or of several on a stage that they share.

    Raises:
        DivergedError: if a state is no longer one of a robot on the ground.
    """
    orders = list(zip(worlds, commands, strict=True))
    left = steps
    while left > 0:
        for world in worlds:
            world.look_round()
        stage = worlds[0].stage
        stage.show({number: who for world in worlds for number, who in world.close_people.items()})
        prepared = [world.prepare(command, left) for world, command in orders]
        chunk = min(steps for steps, _ in prepared)
        pushes = [push for _, push in prepared if push is not None]
        step = stage.step
        for _ in range(chunk):
            for push in pushes:
                push()
            step(False)
        for world in worlds:
            world.settle(chunk)
        left -= chunk


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
