"""Rollers in the air, which turn in closed form.

A roller in the air turns freely in its bearing, except for friction. About its axis a, with the
moment I, the wheel's angular velocity ω and the spin relative to the wheel θ̇,

    I·(θ̈ + d(a·ω)/dt) = -c·θ̇,

(Euler's equation of a body of revolution). Over a step dt DART damps it implicitly, and then
lets the impulses of motors and contacts turn the wheel:

    θ̇' = ρ·θ̇ - Δ,    ρ = 1/(1 + c·dt/I),    Δ = (a·ω)' - a·ω.

`AirborneRollers` sums this over the steps of a chunk. It assumes that the wheel reaches its new
speed in the first step, as with the servo. The effect of a roller on its wheel is that of a mass
without a moment about a (`model.near_tree`), and two torques: c·θ̇·a of its bearing and I·Ω·a×ω of
its spin Ω = θ̇ + a·ω. Their means over the chunk are set as external torques. Their change within a
chunk, some 10 µN·m, is neglected.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from mecazen.links import robot_links
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import Roller

Array = npt.NDArray[np.float64]

_WHEELS = len(WHEELS)


class AirborneRollers:
    """Angle and spin of every roller, by wheel and by place on the wheel.

    `state` (3, 4·N) holds the angle [rad] and the spin relative to the wheel [rad/s], and the
    wheel's own rate about the roller's axis, a·ω [rad/s]. The rollers in the first and the last
    place of each wheel are DART bodies, the others are airborne. Place i is i pitches from the
    first place.

    The `rates` of the wheels are their angular velocities in their own frames, a list of twelve
    [rad/s]: x of all four wheels, then y, then z.

    Products are computed by `numpy.einsum`, which adds in a fixed order. BLAS is not used: its
    kernels differ in the last bit between processors.
    """

    def __init__(self, robot: Robot, dt: float) -> None:
        count = robot.rollers.count
        self._friction = robot.rollers.bearing_friction_nms
        self._inertia = Roller.from_robot(robot).inertia[1]
        self._dt = dt
        self._kept = 1.0 / (1.0 + self._friction * dt / self._inertia)
        # the last row is a·ω after the next chunk
        self._all: Array = np.zeros((4, _WHEELS * count))
        self.state: Array = self._all[:3]
        self.places: Array = self.state.reshape(3, _WHEELS, count)
        """A view of `state`."""
        self._rates = [0.0] * (3 * _WHEELS)
        rollers = robot_links(robot)[_WHEELS : _WHEELS * (1 + count)]
        axes = np.array([roller.rotation[:, 2] for roller in rollers]).T
        axes = axes.reshape(3, _WHEELS, count)
        self._axes: Array = (axes[:, None] * np.eye(_WHEELS)[:, :, None]).reshape(3 * _WHEELS, -1)
        """The matrix from rates to a·ω."""
        self._airborne: Array = axes.copy()
        """The axes of airborne rollers, zero for the bodies."""
        self._airborne[..., [0, -1]] = 0.0

    def set_rates(self, rates: list[float]) -> None:
        """Set the wheels' rates without changing the rollers' spins."""
        self._rates = rates
        self._carry(rates, self.state[2])

    def advance(self, steps: int, rates: list[float]) -> None:
        """Simulate `steps` steps; the wheels reach `rates` in the first step."""
        self._rates = rates
        self._carry(rates, self._all[3])
        transition = _transition(self._kept, self._dt, steps)
        self.state[:] = np.einsum("ij,jr->ir", transition, self._all)

    def torques(self, steps: int) -> list[tuple[float, float, float]]:
        """Return the mean torques on the wheels in `steps` steps, in their frames [N·m]."""
        _, _, after = _sums(self._kept, steps)
        friction, inertia = self._friction * after / steps, self._inertia
        # along x, y, z of each wheel
        sums = np.einsum("awr,kwr->kaw", self._airborne, self.places[1:])
        (sx, sy, sz), (cx, cy, cz) = sums.tolist()
        rates = self._rates
        torques = []
        for i in range(_WHEELS):
            wx, wy, wz = rates[i::_WHEELS]
            hx, hy, hz = sx[i] + cx[i], sy[i] + cy[i], sz[i] + cz[i]
            torques.append(
                (
                    friction * sx[i] + inertia * (hy * wz - hz * wy),
                    friction * sy[i] + inertia * (hz * wx - hx * wz),
                    friction * sz[i] + inertia * (hx * wy - hy * wx),
                )
            )
        return torques

    def _carry(self, rates: list[float], carried: Array) -> None:
        """Write a·ω of each roller [rad/s]."""
        np.einsum("ij,i->j", self._axes, rates, out=carried)


@lru_cache
def _sums(kept: float, steps: int) -> tuple[float, float, float]:
    """Return, for n = `steps`, ρ^(n-1), the sum of ρ^i over i < n, and the sum over 0 < i <= n."""
    before = math.fsum(kept**step for step in range(steps))
    return kept ** (steps - 1), before, kept * before


@lru_cache
def _transition(kept: float, dt: float, steps: int) -> Array:
    """Return the matrix (3, 4) from angle, spin, a·ω and the next a·ω to the next `state`."""
    last, before, after = _sums(kept, steps)
    return np.array(
        [
            [1.0, dt * after, dt * before, -dt * before],
            [0.0, last * kept, last, -last],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
