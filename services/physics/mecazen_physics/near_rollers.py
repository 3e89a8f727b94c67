"""The robot's body with two rollers per wheel: those near the ground.

A wheel that turns by a pitch p = 2π/N looks the same. So its joint keeps an angle q within about
[0, p), which is the real angle less k pitches. The bodies are the rollers in two *places*, at q and
q - p from the bottom, the only rollers near the ground. When q leaves that range, it is shifted
back by a pitch and every roller moves on by one place. Then one of the two bodies takes over the
angle and spin of the other body, since the same roller is at the bottom before and after. The other
body takes over those of an airborne roller. The geometry and inertia of the bodies do not change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics.airborne import AirborneRollers
from mecazen_physics.body import MAX_TILT_RAD, RobotBody
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.model import near_tree
from mecazen_physics.scene import Scene
from mecazen_physics.state import BASE_DOFS, ROOT_DOFS, Motion, quaternion, unrotate

CLEAR_RAD = 0.1
"""Beyond its arc a roller is clear of the ground: by R (1 - cos 0.1), 0.2 mm at R = 50 mm."""
SPEED_MARGIN = 1.5
"""Factor by which a wheel may exceed its present and its commanded speed within a tick."""
PULL_RAD_S2 = 200.0
"""Acceleration of a wheel by weight and grip, in addition to its motor: 1 g at R = 50 mm."""
SLACK_RAD = 0.02
"""Hysteresis of the range of a wheel's angle: a wheel that rests on the border is not shifted back
and forth."""

_WHEELS = len(WHEELS)
_FIRST_ROLLER = BASE_DOFS + _WHEELS


class NearRollersBody(RobotBody):
    """A robot with two rollers per wheel as bodies: only the ground can touch a roller."""

    tree = staticmethod(near_tree)

    def __init__(
        self,
        scene: Scene,
        robot: Robot,
        start: Pose2D,
        physics: PhysicsConfig,
        world: WorldConfig,
    ) -> None:
        super().__init__(scene, robot, start, physics, world)
        count = robot.rollers.count
        self._pitch = math.tau / count
        # The arc of the next roller, which is a pitch long, begins a pitch beyond that of a body.
        self._travel = self._pitch - 2.0 * (CLEAR_RAD + MAX_TILT_RAD + SLACK_RAD)
        if self._travel < robot.wheels.max_speed_rad_s * physics.dt_s:
            raise UnsupportedError(
                f'physics.rollers = "near" needs fewer than {count} rollers a wheel, or '
                f"physics.dt_s = {physics.dt_s} or wheels.max_speed_rad_s = "
                f"{robot.wheels.max_speed_rad_s} smaller: a wheel must not pass a roller in a step"
            )
        self.airborne = AirborneRollers(robot, physics.dt_s)
        self._rolls = [np.roll(np.arange(count), pitches) for pitches in range(count)]
        """Indices that replace `np.roll`, which takes ten times as long."""
        angles, spins, _ = self.airborne.places
        self._body_angles, self._body_spins = angles[:, :: count - 1], spins[:, :: count - 1]
        """Views of the angles and spins of the bodies."""
        self._columns = np.arange(_WHEELS * count)
        """The column of `AirborneRollers.state` of each roller."""
        self._order = self._columns.reshape(_WHEELS, count)
        """A view of `_columns`, by wheel."""
        self._pitches = [0] * _WHEELS
        self._position: list[float] = self.skeleton.getPositions().tolist()
        self._velocity: list[float] = self.skeleton.getVelocities().tolist()

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int) -> int:
        """Shift the angles of wheels whose rollers move on; see `RobotBody`."""
        pull = PULL_RAD_S2 * self._dt * steps
        ahead = [(min(0.0, low - pull), max(0.0, high + pull)) for low, high in speeds]
        ahead_s = SPEED_MARGIN * self._dt
        widest = ahead_s * max(high - low for low, high in ahead)
        if steps * widest > self._travel:
            steps = max(1, int(self._travel / widest))
        moved = False
        half_way = 0.5 * ahead_s * steps
        for wheel, (low, high) in enumerate(ahead):
            middle = self._position[BASE_DOFS + wheel] + half_way * (low + high)
            if not -SLACK_RAD <= middle <= self._pitch + SLACK_RAD:
                pitches = math.floor(middle / self._pitch)
                self._turn_back(wheel, pitches)
                places = self.airborne.places[:, wheel]
                places[:] = places[:, self._rolls[pitches % len(self._rolls)]]
                moved = True
        if moved:
            self._write_bodies()
        for hub, torque in zip(self._hubs, self.airborne.torques(steps), strict=True):
            hub.setExtTorque(torque, True)
        return steps

    def settle(self, steps: int) -> None:
        """Advance the airborne rollers; see `RobotBody`."""
        position, velocity = self.skeleton.getPositions(), self.skeleton.getVelocities()
        self._position, self._velocity = position.tolist(), velocity.tolist()
        self.airborne.advance(steps, self._rates())
        self._body_angles[:] = position[_FIRST_ROLLER:].reshape(_WHEELS, -1)
        self._body_spins[:] = velocity[_FIRST_ROLLER:].reshape(_WHEELS, -1)

    def _turn(self, motion: Motion) -> None:
        super()._turn(motion)
        self._position[:ROOT_DOFS] = motion.position[:ROOT_DOFS]
        self._velocity[:ROOT_DOFS] = motion.velocity[:ROOT_DOFS]

    def read(self) -> Motion:
        """See `RobotBody`."""
        angles, spins = self.airborne.state[:2].take(self._columns, axis=1).tolist()
        position = self._position[:_FIRST_ROLLER] + angles
        for wheel, pitches in enumerate(self._pitches):
            position[BASE_DOFS + wheel] += pitches * self._pitch
        return Motion(position, self._velocity[:_FIRST_ROLLER] + spins, self.scene.heading)

    def write(self, motion: Motion) -> None:
        """See `RobotBody`."""
        motion = motion.in_axes_at(self.scene.heading)
        self._position[:_FIRST_ROLLER] = motion.position[:_FIRST_ROLLER]
        self._velocity[:_FIRST_ROLLER] = motion.velocity[:_FIRST_ROLLER]
        self._pitches = [0] * _WHEELS
        for wheel, angle in enumerate(motion.position[BASE_DOFS:_FIRST_ROLLER]):
            self._turn_back(wheel, math.floor(angle / self._pitch))
        self.airborne.state[0, self._columns] = motion.position[_FIRST_ROLLER:]
        self.airborne.state[1, self._columns] = motion.velocity[_FIRST_ROLLER:]
        self._write_bodies()
        self.airborne.set_rates(self._rates())

    def _turn_back(self, wheel: int, pitches: int) -> None:
        """Subtract whole pitches from a wheel's angle, and move its rollers to their new places."""
        self._position[BASE_DOFS + wheel] -= pitches * self._pitch
        self._pitches[wheel] += pitches
        count = len(self._rolls)
        self._order[wheel] = wheel * count + self._rolls[-self._pitches[wheel] % count]

    def _write_bodies(self) -> None:
        """Write positions and velocities to DART, with those of the two near rollers."""
        self._position[_FIRST_ROLLER:] = self._body_angles.ravel().tolist()
        self._velocity[_FIRST_ROLLER:] = self._body_spins.ravel().tolist()
        self.skeleton.setPositions(self._position)
        self.skeleton.setVelocities(self._velocity)

    def _rates(self) -> list[float]:
        """Return the wheels' rates in the order of `AirborneRollers` [rad/s]."""
        roll, pitch, yaw = unrotate(quaternion(*self._position[:3]), *self._velocity[:3])
        on_axle = roll + self._velocity[BASE_DOFS - 1]
        angles = self._position[BASE_DOFS:_FIRST_ROLLER]
        speeds = self._velocity[BASE_DOFS:_FIRST_ROLLER]
        x, z = [], []
        for angle, rolls in zip(angles, (on_axle, on_axle, roll, roll), strict=True):
            cos, sin = math.cos(angle), math.sin(angle)
            x.append(rolls * cos - yaw * sin)
            z.append(rolls * sin + yaw * cos)
        return [*x, *[pitch + speed for speed in speeds], *z]
