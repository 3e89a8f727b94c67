"""The interacting multiple model (IMM) filter of a walking person, and its extended Kalman filter.

All modes have the state (x, y, yaw, v, w) in odom: position [m], heading [rad], speed along the
heading [m/s] and turn rate [rad/s]. The model is constant turn rate and velocity (CTRV): people
walk in the direction of their heading, so the direction of motion determines the heading. The
heading is not wrapped, so that states can be averaged.

BSLK below is Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.config.follower import CtrvParams, TurnRateParams
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.portable import exp, inverse_and_determinant, product

from mecazen_follower.estimators.base import (
    INITIAL_SPEED_STD_M_S,
    INITIAL_YAW_RATE_STD_RAD_S,
    Array,
    Estimate,
    Estimator,
    as_tuple,
)

SIZE = 5
X, Y, YAW, V, W = range(SIZE)
OBSERVED = 3
"""Size of the observation: the first three components of the state."""
H: Array = np.eye(OBSERVED, SIZE)
"""The observation matrix."""
IDENTITY: Array = np.eye(SIZE)

MAX_STEP_S = 0.1
"""Longest step [s] for the first-order approximations of motion, noise and mode changes."""
SMALL_ANGLE = 1e-3
"""Angle [rad] below which the derivative of sin(a)/a is computed by its series."""
MIN_WEIGHT = 1e-100
"""Lower bound of a mode's probability before normalisation: two outliers could zero all modes."""


class Mode(NamedTuple):
    """A mode of motion; random walks are given by their standard deviations after 1 s."""

    step: float
    """Random walk of the position, since people step aside [m]."""
    heading: float
    """Random walk of the heading [rad]."""
    speed: float
    """Random walk of the speed [m/s]."""
    turn_rate: float
    """Random walk of the turn rate [rad/s]."""
    sojourn_s: float = 1.0
    """Mean sojourn time."""
    fading_1_s: float = 0.0
    """Decay of the turn rate, since people who walk swing about their direction."""
    moves: float = 1.0
    """1 if the speed persists, 0 if it is only its random walk."""
    turns: float = 1.0
    """1 if the turn rate persists, 0 if it is only its random walk."""


MIN_STEP = 0.001
"""Random walk [m] of the position in addition to sway."""
STANDING = Mode(0.00026, 0.017, 0.02, 0.02, 3.5, moves=0.0, turns=0.0)
STRAIGHT = Mode(0.0023, 0.11, 0.0036, 0.02, 2.6, turns=0.0)
TURNING = Mode(0.001, 0.001, 0.0015, 0.0043, 34.0, 0.0096)
WINDING = Mode(0.001, 0.001, 0.0067, 0.43, 9.8, 0.34)
WANDERING = Mode(0.001, 0.0031, 0.45, 1.8, 1.5, 6.1)
MANOEUVRING = Mode(0.11, 0.0022, 0.37, 3.3, 1.9, 1.2)
MODES = STANDING, STRAIGHT, TURNING, WINDING, WANDERING, MANOEUVRING
"""How people walk, chosen on random walkers and recorded walks by the likelihood of what a sensor
sees: docs/following.md. The same for every sensor."""


def ctrv(x: Array, dt: float, fading: float = 0.0) -> tuple[Array, Array]:
    """Return the state x (5) after `dt` [s], and the Jacobian F (5, 5) of this motion.

    BSLK 11.7, written with the chord of the arc. After the motion the turn rate has decayed by
    exp(-fading dt): an Ornstein-Uhlenbeck process.
    """
    px, py, yaw, v, w = x.tolist()
    half = w * dt / 2.0
    sinc = math.sin(half) / half if half else 1.0
    slope = -half / 3.0 if abs(half) < SMALL_ANGLE else (math.cos(half) - sinc) / half
    c, s = math.cos(yaw + half), math.sin(yaw + half)
    chord, bend = v * dt * sinc, v * dt * dt / 2.0
    kept = math.exp(-fading * dt)
    moved = np.array((px + chord * c, py + chord * s, yaw + w * dt, v, kept * w))
    F = np.array(
        (
            (1.0, 0.0, -chord * s, dt * sinc * c, bend * (slope * c - sinc * s)),
            (0.0, 1.0, chord * c, dt * sinc * s, bend * (slope * s + sinc * c)),
            (0.0, 0.0, 1.0, 0.0, dt),
            (0.0, 0.0, 0.0, 1.0, 0.0),
            (0.0, 0.0, 0.0, 0.0, kept),
        )
    )
    return moved, F


def process_noise(variances: Sequence[float], x: Array, dt: float) -> Array:
    """Return the covariance Q (5, 5) that random walks add in `dt` [s], to first order.

    The discretised white accelerations of BSLK 6.2.2, along the heading and of the heading.

    Args:
        variances: The random walks' variances: of the position after 1 m walked, and of position,
            heading, speed and turn rate after 1 s.
        x: The state (5) at which the random walks start.
        dt: Time [s].
    """
    sway, step, heading, speed, turn_rate = (variance * dt for variance in variances)
    _, _, yaw, v, _ = x.tolist()
    c, s = math.cos(yaw), math.sin(yaw)
    position = sway * abs(v) + step
    third, half = speed * dt * dt / 3.0, speed * dt / 2.0
    return np.array(
        (
            (position + third * c * c, third * c * s, 0.0, half * c, 0.0),
            (third * c * s, position + third * s * s, 0.0, half * s, 0.0),
            (0.0, 0.0, heading + turn_rate * dt * dt / 3.0, 0.0, turn_rate * dt / 2.0),
            (half * c, half * s, 0.0, speed, 0.0),
            (0.0, 0.0, turn_rate * dt / 2.0, 0.0, turn_rate),
        )
    )


def congruence(F: Array, P: Array) -> Array:
    """Return F P Fᵀ, also of stacks of matrices."""
    return product(product(F, P), F.swapaxes(-1, -2))


class ImmBank:
    """An extended Kalman filter for each mode, interacting: with one mode, an extended filter.

    Blom, Bar-Shalom: The interacting multiple model algorithm for systems with Markovian switching
    coefficients, IEEE Trans. Automatic Control 33, 1988; BSLK 11.6.6, whose steps are named here.

    Args:
        modes: n modes; the transitions from a mode to each other mode are equally probable.
        sway: Random walk of the position after 1 m walked [m].
        x: The initial state (5) of all modes.
        P: Covariance (5, 5) of `x`.

    Attributes:
        mu: Probabilities (n) of the modes.
        x: Their states (n, 5).
        P: Their covariances (n, 5, 5).
        nis: Mean normalised innovation squared of the last update.
        log_likelihood: Logarithm of the density of the last observation [1/(m² rad)], given all
            before it.
    """

    def __init__(self, modes: Sequence[Mode], sway: float, x: Array, P: Array) -> None:
        n = len(modes)
        self.mu: Array = np.full(n, 1.0 / n)
        self.x: Array = np.repeat(x[None], n, axis=0)
        self.P: Array = np.repeat(P[None], n, axis=0)
        self.nis = 0.0
        self.log_likelihood = 0.0
        self._sojourn = np.array([mode.sojourn_s for mode in modes])
        self._fading = np.array([mode.fading_1_s for mode in modes])
        self._variances = np.array([(sway, *mode[:4]) for mode in modes]) ** 2
        self._persists = np.array([(1.0, 1.0, 1.0, mode.moves, mode.turns) for mode in modes])

    def predict(self, dt: float) -> None:
        """Mix the modes and propagate each by `dt` [s]."""
        self._mix(dt)
        self.x *= self._persists
        self.P *= self._persists[:, :, None] * self._persists[:, None, :]
        Q = [process_noise(*row, dt) for row in zip(self._variances.tolist(), self.x, strict=True)]
        moves = [ctrv(x, dt, fading) for x, fading in zip(self.x, self._fading, strict=True)]
        self.x = np.array([x for x, _ in moves])
        F = np.array([F for _, F in moves])
        self.P = congruence(F, self.P) + Q

    def _mix(self, dt: float) -> None:
        """Compute the mixing probabilities, and mix the states: steps 1 and 2."""
        n = len(self.mu)
        # after a long step all modes are equally probable
        change = np.minimum(dt / self._sojourn / max(n - 1, 1), 1.0 / n)
        joint = self.mu[:, None] * (np.eye(n) + change[:, None] * (1.0 - n * np.eye(n)))
        self.mu = joint.sum(axis=0)
        mixing = joint / self.mu
        x = np.einsum("ij,ia->ja", mixing, self.x)
        d = self.x[:, None] - x
        self.P = np.einsum("ij,iab->jab", mixing, self.P) + np.einsum(
            "ij,ija,ijb->jab", mixing, d, d
        )
        self.x = x

    def update(self, z: Array, R: Array) -> None:
        """Correct with an observation z (3) and its positive definite covariance R (3, 3)."""
        # step 3: the Kalman filter of each mode, in Joseph's form, BSLK 5.2.3
        y = z - self.x[:, :OBSERVED]
        PHt = self.P[:, :, :OBSERVED]
        inverse, determinant = inverse_and_determinant(PHt[:, :OBSERVED] + R)
        K = product(PHt, inverse)
        self.x = self.x + np.einsum("nij,nj->ni", K, y)
        self.P = congruence(IDENTITY - product(K, H), self.P) + congruence(K, R)
        # step 4: the probabilities of the modes, by their likelihoods
        nis = np.einsum("ni,nij,nj->n", y, inverse, y)
        self.nis = float(np.sum(self.mu * nis))
        likelihood = exp((nis.min() - nis) / 2.0) / np.sqrt(math.tau**OBSERVED * determinant)
        weights = np.maximum(self.mu * likelihood, MIN_WEIGHT)
        self.log_likelihood = math.log(weights.sum()) - float(nis.min()) / 2.0
        self.mu = weights / weights.sum()

    def ahead(self, dt: float) -> tuple[Array, Array]:
        """Return state (5) and covariance (5, 5) `dt` [s] later, without changes of the mode.

        All modes are combined first, step 5. Their random walks have the mean variances.
        """
        x = np.einsum("n,na->a", self.mu, self.x)
        d = self.x - x
        P = np.einsum("n,nab->ab", self.mu, self.P) + np.einsum("n,na,nb->ab", self.mu, d, d)
        variances = np.einsum("n,na->a", self.mu, self._variances).tolist()
        Q = process_noise(variances, x, dt)
        x, F = ctrv(x, dt, float(np.sum(self.mu * self._fading)))
        return x, congruence(F, P) + Q


class ImmFilter(Estimator, name="imm"):
    """An IMM of six modes: standing, straight, turning steadily, winding, wandering, manoeuvring.

    The manoeuvring mode covers setting off, stopping, side steps and quick turns; it takes over
    within a few frames. The wandering mode is how real people walk. The other modes average over
    seconds.

    The bank is propagated only when an observation comes; between observations, `ahead` is cheaper.
    """

    def __init__(self, params: TurnRateParams) -> None:
        super().__init__(params)
        self._sway = params.sway_m_sqrt_m
        self._modes: Sequence[Mode] = MODES
        self.reset()

    def reset(self) -> None:
        self.nis = None
        self._bank: ImmBank | None = None
        self._elapsed = 0.0

    def predict(self, dt: float) -> None:
        self._elapsed += dt
        if self._elapsed >= MAX_STEP_S:
            self._catch_up()

    def _catch_up(self) -> None:
        if self._bank is not None and self._elapsed > 0.0:
            steps = math.ceil(self._elapsed / MAX_STEP_S - 1e-9)
            for _ in range(steps):
                self._bank.predict(self._elapsed / steps)
        self._elapsed = 0.0

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        self._catch_up()
        z = np.array(observation)
        if self._bank is None:
            x, P = np.zeros(SIZE), np.zeros((SIZE, SIZE))
            x[:OBSERVED], P[:OBSERVED, :OBSERVED] = z, noise
            P[V, V], P[W, W] = INITIAL_SPEED_STD_M_S**2, INITIAL_YAW_RATE_STD_RAD_S**2
            self._bank = ImmBank(self._modes, self._sway, x, P)
            return
        yaw = float(np.sum(self._bank.mu * self._bank.x[:, YAW]))
        z[YAW] = yaw + wrap(observation.yaw - yaw)
        self._bank.update(z, noise)
        self.nis = self._bank.nis

    @property
    def estimate(self) -> Estimate | None:
        return self.ahead(0.0)

    def ahead(self, dt: float) -> Estimate | None:
        """Return the estimate `dt` [s] from now, with its propagated covariance."""
        if self._bank is None:
            return None
        x, P = self._bank.ahead(self._elapsed + dt)
        px, py, yaw, v, w = x.tolist()
        velocity = Twist2D(v * math.cos(yaw), v * math.sin(yaw), w)
        return Estimate(Pose2D(px, py, wrap(yaw)), velocity, as_tuple(P[:OBSERVED, :OBSERVED]))


class ExtendedFilter(ImmFilter, name="ekf_ctrv"):
    """An extended Kalman filter of constant turn rate and velocity: a bank of one mode."""

    def __init__(self, params: CtrvParams) -> None:
        super().__init__(params)
        speed, turn_rate = params.acceleration_std_m_s2, params.yaw_acceleration_std_rad_s2
        self._modes = (Mode(MIN_STEP, 0.0, speed, turn_rate),)
