"""The robot with two rollers a wheel as bodies, while no other can touch anything.

A wheel that turns by a pitch p = 2π/N looks the same. So its joint keeps an angle q within
about [0, p), the real one less k pitches, and the bodies are the rollers in two *places*: at q
and q - p from the bottom, the only ones near the ground. When q leaves that range it is
brought back by a pitch and every roller moves on by one place: one of the two bodies gets the
angle and spin of the other, which is at the bottom in both cases, and the other those of a
roller in the air. No geometry and no inertia of the bodies changes.

A roller in the air turns freely in its bearing but for friction. About its axis a, with the
moment I, the wheel's angular velocity ω and the spin relative to the wheel θ̇,

    I·(θ̈ + d(a·ω)/dt) = -c·θ̇,

(Euler's equation of a body of revolution). Over a step dt DART damps it implicitly, and then
lets the impulses of motors and contacts turn the wheel:

    θ̇' = ρ·θ̇ - Δ,    ρ = 1/(1 + c·dt/I),    Δ = (a·ω)' - a·ω.

`Air` sums that over the steps of a chunk as if the wheel came to its new speed in the first of
them, as the servo makes it. On its wheel the roller acts as a mass without a moment about a
(`model.near`), and with the torques c·θ̇·a of its bearing and I·Ω·a×ω of its spin Ω = θ̇ + a·ω,
whose means over the chunk are set as external ones. What is neglected is how they change
within a chunk: some 10 µN·m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import model
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.reach import MAX_TILT_RAD, SPEED_MARGIN
from mecazen_physics.rollers import Roller
from mecazen_physics.scene import BASE_DOFS, Motion, Scene

Array = npt.NDArray[np.float64]

CLEAR_RAD = 0.1
"""Beyond its arc a roller is clear of the ground: by R (1 - cos 0.1), 0.2 mm at R = 50 mm."""
PULL_RAD_S2 = 200.0
"""What weight and grip give a wheel beside its motor: 1 g at R = 50 mm."""
SLACK_RAD = 0.02
"""How far beyond its range a wheel may be expected before it is brought back: one that rests
on the border is not brought back and forth."""

_WHEELS = len(WHEELS)
_ON_AXLE = [wheel.startswith("front") for wheel in WHEELS]
_FIRST_ROLLER = BASE_DOFS + _WHEELS


class Air:
    """Angle and spin of every roller, of which those in the air turn in closed form.

    `state` (3, 4·N) holds, by wheel and place, the angle [rad] and the spin relative to the
    wheel [rad/s], and the wheel's own turning about the roller's axis, a·ω [rad/s]. Place i is
    i pitches from that of the first body, so the other body is in the last.
    """

    def __init__(self, robot: Robot, dt: float) -> None:
        count = robot.rollers.count
        friction, inertia = robot.rollers.bearing_friction_nms, Roller.of(robot).inertia[1]
        self._dt = dt
        self._kept = 1.0 / (1.0 + friction * dt / inertia)
        # the last row is a·ω after the chunk to come
        self._all: Array = np.zeros((4, _WHEELS * count))
        self._next: Array = np.zeros((3, _WHEELS * count))
        self.state: Array = self._all[:3]
        self._spins: Array = self._all[1:3].reshape(-1)
        angles, rates, _, _ = self._all.reshape(4, _WHEELS, count)
        self.angles, self.rates = angles[:, :: count - 1], rates[:, :: count - 1]
        """Those of the bodies (4, 2), to be written."""
        self._turning = [0.0] * (3 * _WHEELS)
        axes = np.zeros((_WHEELS, count, _WHEELS, 3))
        rollers = iter(model.links(robot)[_WHEELS:])
        for wheel in range(_WHEELS):
            for place in range(count):
                axes[wheel, place, wheel] = next(rollers).rotation[:, 2]
        self._axes: Array = axes.reshape(_WHEELS * count, 3 * _WHEELS)
        axes = axes.copy()
        axes[:, [0, -1]] = 0.0
        airborne = axes.reshape(self._axes.shape).T
        # of spins and a·ω: the bearings' torques and the angular momenta about the axes
        self._loads: Array = np.block(
            [[friction * airborne, 0.0 * airborne], [inertia * airborne, inertia * airborne]]
        )

    def note(self, turning: list[float]) -> None:
        """Take the wheels as `turning`, x, y, z of each in its own frame [rad/s]."""
        self._turning = turning
        self.state[2] = self._axes @ turning

    def advance(self, steps: int, turning: list[float]) -> None:
        """Simulate `steps` steps, in the first of which the wheels come to be `turning`."""
        self._turning = turning
        np.dot(self._axes, turning, out=self._all[3])
        self.state[:] = np.dot(_law(self._kept, self._dt, steps), self._all, out=self._next)

    def torques(self, steps: int) -> list[tuple[float, float, float]]:
        """Return the mean torques on the wheels in `steps` steps, in their frames [N·m]."""
        _, _, after = _sums(self._kept, steps)
        mean = after / steps
        loads = (self._loads @ self._spins).tolist()
        turning = self._turning
        torques = []
        for i in range(0, 3 * _WHEELS, 3):
            fx, fy, fz = loads[i : i + 3]
            hx, hy, hz = loads[3 * _WHEELS + i : 3 * _WHEELS + i + 3]
            wx, wy, wz = turning[i : i + 3]
            torques.append(
                (
                    mean * fx + hy * wz - hz * wy,
                    mean * fy + hz * wx - hx * wz,
                    mean * fz + hx * wy - hy * wx,
                )
            )
        return torques


@lru_cache
def _sums(kept: float, steps: int) -> tuple[float, float, float]:
    """Return for n = `steps` ρ^(n-1), the sum of ρ^i for i < n, and that for 0 < i <= n."""
    before = np.sum(kept ** np.arange(steps))
    return kept ** (steps - 1), float(before), kept * float(before)


@lru_cache
def _law(kept: float, dt: float, steps: int) -> Array:
    """Return what makes of angle, spin, a·ω and the next a·ω the next three (3, 4)."""
    last, before, after = _sums(kept, steps)
    return np.array(
        [
            [1.0, dt * after, dt * before, -dt * before],
            [0.0, last * kept, last, -last],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


class NearScene(Scene):
    """The robot with two rollers a wheel as bodies, alone on the ground.

    Raises:
        UnsupportedError: if the rollers are too many for the fastest wheel in a step.
    """

    _NEAR = True

    def __init__(self, robot: Robot, config: PhysicsConfig, start: Pose2D) -> None:
        super().__init__(robot, config, start)
        count = robot.rollers.count
        self._dt = config.dt_s
        self._pitch = math.tau / count
        # The arc, a pitch long, of the next roller begins a pitch beyond that of a body.
        self._travel = self._pitch - 2.0 * (CLEAR_RAD + MAX_TILT_RAD + SLACK_RAD)
        if self._travel < robot.wheels.max_speed_rad_s * config.dt_s:
            raise UnsupportedError(
                f'physics.rollers = "near" needs fewer than {count} rollers a wheel, or '
                f"physics.dt_s = {config.dt_s} or wheels.max_speed_rad_s = "
                f"{robot.wheels.max_speed_rad_s} smaller: a wheel must not pass a roller in a step"
            )
        self._base = self.robot.getBodyNode(0)
        self._air = Air(robot, config.dt_s)
        self._places = np.arange(_WHEELS * count).reshape(_WHEELS, count)
        self._order = self._places.copy()
        self._rolls = [np.roll(np.arange(count), pitches) for pitches in range(count)]
        self._pitches = [0] * _WHEELS
        self._position: list[float] = self.robot.getPositions().tolist()
        self._velocity: list[float] = self.robot.getVelocities().tolist()

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int, *, alone: bool) -> int:
        """Bring wheels back whose rollers have moved on; see `Scene`."""
        del alone
        pull = PULL_RAD_S2 * self._dt * steps
        ahead = [(min(0.0, low - pull), max(0.0, high + pull)) for low, high in speeds]
        widest = SPEED_MARGIN * self._dt * max(high - low for low, high in ahead)
        if steps * widest > self._travel:
            steps = max(1, int(self._travel / widest))
        moved = False
        half_way = 0.5 * SPEED_MARGIN * self._dt * steps
        angles = self._position[BASE_DOFS:_FIRST_ROLLER]
        for wheel, ((low, high), angle) in enumerate(zip(ahead, angles, strict=True)):
            middle = angle + half_way * (low + high)
            if not -SLACK_RAD <= middle <= self._pitch + SLACK_RAD:
                self._bring_back(wheel, math.floor(middle / self._pitch))
                moved = True
        if moved:
            self._put()
        for hub, torque in zip(self._hubs, self._air.torques(steps), strict=True):
            hub.setExtTorque(torque, True)
        return steps

    def settle(self, steps: int) -> None:
        """Turn the rollers in the air; see `Scene`."""
        position, velocity = self.robot.getPositions(), self.robot.getVelocities()
        self._position, self._velocity = position.tolist(), velocity.tolist()
        self._air.advance(steps, self._turning())
        self._air.angles[:] = position[_FIRST_ROLLER:].reshape(_WHEELS, -1)
        self._air.rates[:] = velocity[_FIRST_ROLLER:].reshape(_WHEELS, -1)

    def read(self) -> Motion:
        """See `Scene`."""
        angles, rates = self._air.state[:2, self._order.ravel()].tolist()
        position, velocity = self._position, self._velocity
        turned = [
            angle + pitches * self._pitch
            for angle, pitches in zip(position[BASE_DOFS:_FIRST_ROLLER], self._pitches, strict=True)
        ]
        return Motion(
            position[:BASE_DOFS],
            velocity[:BASE_DOFS],
            turned + angles,
            velocity[BASE_DOFS:_FIRST_ROLLER] + rates,
        )

    def write(self, motion: Motion) -> None:
        """See `Scene`."""
        self._position[:BASE_DOFS] = motion.base_position
        self._velocity[:BASE_DOFS] = motion.base_velocity
        self._velocity[BASE_DOFS:_FIRST_ROLLER] = motion.joint_velocity[:_WHEELS]
        for wheel, angle in enumerate(motion.joint_position[:_WHEELS]):
            pitches = math.floor(angle / self._pitch)
            self._position[BASE_DOFS + wheel] = angle - pitches * self._pitch
            self._set_pitches(wheel, pitches)
        self._air.state[0, self._order.ravel()] = motion.joint_position[_WHEELS:]
        self._air.state[1, self._order.ravel()] = motion.joint_velocity[_WHEELS:]
        self._put()
        self._air.note(self._turning())

    def _bring_back(self, wheel: int, pitches: int) -> None:
        self._position[BASE_DOFS + wheel] -= pitches * self._pitch
        self._set_pitches(wheel, self._pitches[wheel] + pitches)
        places = self._places[wheel]
        self._air.state[:, places] = self._air.state[:, self._rolled(wheel, pitches)]

    def _set_pitches(self, wheel: int, pitches: int) -> None:
        self._pitches[wheel] = pitches
        self._order[wheel] = self._rolled(wheel, -pitches)

    def _rolled(self, wheel: int, pitches: int) -> Array:
        """Return the wheel's places as `np.roll` does, which takes ten times as long."""
        places: Array = self._places[wheel, self._rolls[pitches % len(self._rolls)]]
        return places

    def _put(self) -> None:
        """Put the bodies where the rollers in their places are."""
        self._position[_FIRST_ROLLER:] = self._air.angles.ravel().tolist()
        self._velocity[_FIRST_ROLLER:] = self._air.rates.ravel().tolist()
        self.robot.setPositions(self._position)
        self.robot.setVelocities(self._velocity)

    def _turning(self) -> list[float]:
        """Return the wheels' angular velocities, as `Air` takes them [rad/s]."""
        x, y, z, _, _, _ = self._base.getSpatialVelocity().tolist()
        rolls = (x, x + self._velocity[BASE_DOFS - 1])
        angles = self._position[BASE_DOFS:_FIRST_ROLLER]
        rates = self._velocity[BASE_DOFS:_FIRST_ROLLER]
        turning: list[float] = []
        for on_axle, angle, rate in zip(_ON_AXLE, angles, rates, strict=True):
            cos, sin, roll = math.cos(angle), math.sin(angle), rolls[on_axle]
            turning += (roll * cos - z * sin, y + rate, roll * sin + z * cos)
        return turning
