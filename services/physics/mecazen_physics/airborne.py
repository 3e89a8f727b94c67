"""Rollers in the air, which turn in closed form.

A roller in the air turns freely in its bearing but for friction. About its axis a, with the
moment I, the wheel's angular velocity ω and the spin relative to the wheel θ̇,

    I·(θ̈ + d(a·ω)/dt) = -c·θ̇,

(Euler's equation of a body of revolution). Over a step dt DART damps it implicitly, and then
lets the impulses of motors and contacts turn the wheel:

    θ̇' = ρ·θ̇ - Δ,    ρ = 1/(1 + c·dt/I),    Δ = (a·ω)' - a·ω.

`AirborneRollers` sums this over the steps of a chunk as if the wheel reached its new speed in
the first of them, as the servo makes it. For its wheel the roller is a mass without a moment
about a (`model.near_tree`), and two torques: c·θ̇·a of its bearing and I·Ω·a×ω of its spin
Ω = θ̇ + a·ω. Their means over the chunk are set as external torques. Their change within a
chunk, some 10 µN·m, is neglected.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from mecazen.portable import product
from mecazen.robot import WHEELS, Robot

from mecazen_physics import model
from mecazen_physics.rollers import Roller

Array = npt.NDArray[np.float64]

_WHEELS = len(WHEELS)


class AirborneRollers:
    """Angle and spin of every roller, by wheel and place.

    `state` (3, 4·N) holds the angle [rad] and the spin relative to the wheel [rad/s], and the
    wheel's own rate about the roller's axis, a·ω [rad/s]. The rollers in the first and the last
    place of each wheel are bodies of DART, the others are airborne. Place i is i pitches from
    the first.

    A wheel's `rates` are its angular velocity, x, y, z in its own frame; those of all four make
    a list of twelve [rad/s].
    """

    def __init__(self, robot: Robot, dt: float) -> None:
        count = robot.rollers.count
        friction, inertia = robot.rollers.bearing_friction_nms, Roller.of(robot).inertia[1]
        self._dt = dt
        self._kept = 1.0 / (1.0 + friction * dt / inertia)
        # the last row is a·ω after the next chunk
        self._all: Array = np.zeros((4, _WHEELS * count))
        self.state: Array = self._all[:3]
        self.places: Array = self.state.reshape(3, _WHEELS, count)
        """A view of `state`."""
        self._spins: Array = self._all[1:3].reshape(-1)
        angles, spins, _, _ = self._all.reshape(4, _WHEELS, count)
        self.body_angles, self.body_spins = angles[:, :: count - 1], spins[:, :: count - 1]
        """Views (4, 2) of those of the bodies, to be written."""
        self._rates = [0.0] * (3 * _WHEELS)
        axes = np.zeros((_WHEELS, count, _WHEELS, 3))
        for index, roller in enumerate(model.links(robot)[_WHEELS : _WHEELS * (1 + count)]):
            wheel, place = divmod(index, count)
            axes[wheel, place, wheel] = roller.rotation[:, 2]
        self._axes: Array = axes.reshape(_WHEELS * count, 3 * _WHEELS)
        axes = axes.copy()
        axes[:, [0, -1]] = 0.0
        airborne = axes.reshape(self._axes.shape).T
        # From spins and a·ω to the bearings' torques and the angular momenta about the axes.
        self._loads: Array = np.block(
            [[friction * airborne, 0.0 * airborne], [inertia * airborne, inertia * airborne]]
        )

    def set_rates(self, rates: list[float]) -> None:
        """Set the wheels' rates without an effect on the rollers' spins."""
        self._rates = rates
        self.state[2] = product(self._axes, rates)

    def advance(self, steps: int, rates: list[float]) -> None:
        """Simulate `steps` steps, in the first of which the wheels reach `rates`."""
        self._rates = rates
        self._all[3] = product(self._axes, rates)
        self.state[:] = product(_transition(self._kept, self._dt, steps), self._all)

    def torques(self, steps: int) -> list[tuple[float, float, float]]:
        """Return the mean torques on the wheels in `steps` steps, in their frames [N·m]."""
        _, _, after = _sums(self._kept, steps)
        mean = after / steps
        loads = product(self._loads, self._spins).tolist()
        rates = self._rates
        torques = []
        for i in range(0, 3 * _WHEELS, 3):
            fx, fy, fz = loads[i : i + 3]
            hx, hy, hz = loads[3 * _WHEELS + i : 3 * _WHEELS + i + 3]
            wx, wy, wz = rates[i : i + 3]
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
    """Return, for n = `steps`, ρ^(n-1), the sum of ρ^i over i < n, and that over 0 < i <= n."""
    before = math.fsum(kept**i for i in range(steps))
    return kept ** (steps - 1), before, kept * before


@lru_cache
def _transition(kept: float, dt: float, steps: int) -> Array:
    """Return the matrix (3, 4) from angle, spin, a·ω and the next a·ω to the next three."""
    last, before, after = _sums(kept, steps)
    return np.array(
        [
            [1.0, dt * after, dt * before, -dt * before],
            [0.0, last * kept, last, -last],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
