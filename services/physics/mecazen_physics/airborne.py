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
from mecazen.robot import WHEELS, Robot

from mecazen_physics import model
from mecazen_physics.rollers import Roller

Array = npt.NDArray[np.float64]

Rates = tuple[list[float], list[float], list[float]]

_WHEELS = len(WHEELS)


class AirborneRollers:
    """Angle and spin of every roller, by wheel and place.

    The rollers in the first and the last place of each wheel are bodies of DART, the others are
    airborne. Place i is i pitches from the first. Arrays (4, N) hold for each roller its angle
    [rad], its spin relative to the wheel, the wheel's own rate about the roller's axis, a·ω, and
    their sum Ω [rad/s]. All sums are in a fixed order, the same on every processor.

    The `rates` of the wheels are their angular velocities in their own frames: x of all four, y, z
    [rad/s].
    """

    def __init__(self, robot: Robot, dt: float) -> None:
        count = robot.rollers.count
        self._friction = robot.rollers.bearing_friction_nms
        self._inertia = Roller.of(robot).inertia[1]
        self._dt = dt
        self._kept = 1.0 / (1.0 + self._friction * dt / self._inertia)
        self.places: Array = np.zeros((4, _WHEELS, count))
        """Angle, a·ω, spin and Ω of each roller."""
        self.angles, self._carried, self.spins, self._total = self.places
        self._rates: Rates = ([0.0] * _WHEELS,) * 3
        rollers = model.links(robot)[_WHEELS : _WHEELS * (1 + count)]
        axes = np.array([roller.rotation[:, 2] for roller in rollers])
        self._axes: Array = axes.T.reshape(3, _WHEELS, count).copy()
        self._airborne: Array = self._axes[:, None].copy()
        """Axes of the airborne rollers, zero for the bodies."""
        self._airborne[..., [0, -1]] = 0.0

    def set_rates(self, rates: Rates) -> None:
        """Set the wheels' rates without an effect on the rollers' spins."""
        self._rates = rates
        self._carried[:] = self._carry(rates)

    def advance(self, steps: int, rates: Rates) -> None:
        """Simulate `steps` steps, in the first of which the wheels reach `rates`."""
        self._rates = rates
        carried = self._carry(rates)
        of_spin, of_change = _transition(self._kept, self._dt, steps)
        moved = of_spin * self.spins + of_change * (carried - self._carried)
        self.angles += moved[0]
        self.spins[:] = moved[1]
        self._carried[:] = carried

    def torques(self, steps: int) -> list[tuple[float, float, float]]:
        """Return the mean torques on the wheels in `steps` steps, in their frames [N·m]."""
        _, _, after = _sums(self._kept, steps)
        friction, inertia = self._friction * after / steps, self._inertia
        np.add(self.spins, self._carried, out=self._total)
        # of spins and Ω along the rollers' axes, by wheel
        sums = np.add.reduce(self._airborne * self.places[2:], axis=-1)
        columns = [column for of_axis in sums.tolist() for column in of_axis]
        return [
            (
                friction * fx + inertia * (hy * wz - hz * wy),
                friction * fy + inertia * (hz * wx - hx * wz),
                friction * fz + inertia * (hx * wy - hy * wx),
            )
            for fx, hx, fy, hy, fz, hz, wx, wy, wz in zip(*columns, *self._rates, strict=True)
        ]

    def _carry(self, rates: Rates) -> Array:
        """Return a·ω of each roller (4, N) [rad/s]."""
        products = self._axes * np.array(rates)[:, :, None]
        carried: Array = products[0] + products[1] + products[2]
        return carried


@lru_cache
def _sums(kept: float, steps: int) -> tuple[float, float, float]:
    """Return, for n = `steps`, ρ^(n-1), the sum of ρ^i over i < n, and that over 0 < i <= n."""
    before = math.fsum(kept**step for step in range(steps))
    return kept ** (steps - 1), before, kept * before


@lru_cache
def _transition(kept: float, dt: float, steps: int) -> tuple[Array, Array]:
    """Return what a spin and a change of a·ω each add to the angle, and make of the spin."""
    last, before, after = _sums(kept, steps)
    of_spin, of_change = np.array([dt * after, last * kept]), np.array([-dt * before, -last])
    return of_spin.reshape(2, 1, 1), of_change.reshape(2, 1, 1)
