"""Constant turn rate and velocity (CTRV): people walk where they look.

The state is (x, y, yaw, v, w) in odom: position [m], heading [rad], speed along the heading
[m/s] and turn rate [rad/s]; the heading is not wrapped, so that means of states are means.
What ties position and heading together is what a filter of independent axes does not know:
the direction of the motion tells the heading, and the heading the motion.

The model is of Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and
Navigation, section 11.7, written with the chord of the arc that is walked:
x += c·cos(yaw + w dt/2), y += c·sin(yaw + w dt/2), c = v dt·sin(w dt/2)/(w dt/2).
"""

from __future__ import annotations

import math

import numpy as np
from mecazen.geometry import Pose2D, Twist2D, wrap

from mecazen_follower.estimators.base import Array, Estimate
from mecazen_follower.estimators.kalman import as_tuple

SIZE = 5
X, Y, YAW, V, W = range(SIZE)
SEEN = 3
"""The observation is the first three of the state."""

Walks = tuple[float, float, float, float, float]
"""Random walks, see `process_noise`."""

IDENTITY: Array = np.eye(SIZE)
SEES: Array = np.eye(SEEN, SIZE)
"""What turns a state into what is seen of it (3, 5)."""
NEAR_0 = 1e-3
"""Angle [rad] below which the derivative of sin(a)/a is the first term of its series."""


def move(state: Array, dt: float) -> Array:
    """Return the state (5) after `dt` [s]."""
    x, y, yaw, v, w = state.tolist()
    half = w * dt / 2.0
    chord = v * dt * _sinc(half)
    along = yaw + half
    return np.array([x + chord * math.cos(along), y + chord * math.sin(along), yaw + w * dt, v, w])


def jacobian(state: Array, dt: float) -> Array:
    """Return the derivatives (5, 5) of `move` by the state."""
    _, _, yaw, v, w = state.tolist()
    half = w * dt / 2.0
    sinc = _sinc(half)
    slope = -half / 3.0 if abs(half) < NEAR_0 else (math.cos(half) - sinc) / half
    c, s = math.cos(yaw + half), math.sin(yaw + half)
    chord, bend = v * dt * sinc, v * dt * dt / 2.0
    F = IDENTITY.copy()
    F[X, YAW], F[Y, YAW] = -chord * s, chord * c
    F[X, V], F[Y, V] = dt * sinc * c, dt * sinc * s
    F[X, W], F[Y, W] = bend * (slope * c - sinc * s), bend * (slope * s + sinc * c)
    F[YAW, W] = dt
    return F


def _sinc(angle: float) -> float:
    return math.sin(angle) / angle if angle else 1.0


def process_noise(walks: Walks, state: Array, dt: float) -> Array:
    """Return the covariance (5, 5) that random walks add in `dt` [s].

    Args:
        walks: What disturbs position, heading, speed and turn rate, each as the
            standard deviation that its random walk has after 1 s. That of the position, to
            all sides, comes twice: after 1 m walked, since who walks faster sways more
            often, and after 1 s.
        state: Where the walks begin (5).
        dt: Time [s]; to first order in it.
    """
    sway, step, heading, speed, rate = (walk * walk * dt for walk in walks)
    _, _, yaw, v, _ = state.tolist()
    position = sway * abs(v) + step
    c, s = math.cos(yaw), math.sin(yaw)
    way, ahead = speed * dt * dt / 3.0, speed * dt / 2.0
    Q = np.zeros((SIZE, SIZE))
    Q[X, X], Q[Y, Y] = position + way * c * c, position + way * s * s
    Q[X, Y] = Q[Y, X] = way * c * s
    Q[X, V] = Q[V, X] = ahead * c
    Q[Y, V] = Q[V, Y] = ahead * s
    Q[V, V] = speed
    Q[YAW, YAW] = heading + rate * dt * dt / 3.0
    Q[YAW, W] = Q[W, YAW] = rate * dt / 2.0
    Q[W, W] = rate
    return Q


def near(yaw: float, observation: Pose2D) -> Array:
    """Return an observation (3) with the turn of its yaw that is nearest to `yaw`."""
    return np.array([observation.x, observation.y, yaw + wrap(observation.yaw - yaw)])


def estimate_of(state: Array, covariance: Array) -> Estimate:
    """Return a state (5) and its covariance (5, 5) as an estimate."""
    x, y, yaw, v, w = state.tolist()
    velocity = Twist2D(v * math.cos(yaw), v * math.sin(yaw), w)
    return Estimate(Pose2D(x, y, wrap(yaw)), velocity, as_tuple(covariance[:SEEN, :SEEN]))
