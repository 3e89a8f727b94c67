"""Constant turn rate and velocity (CTRV): people walk in the direction of their heading.

The state is (x, y, yaw, v, w) in odom: position [m], heading [rad], speed along the heading
[m/s] and turn rate [rad/s]. The heading is not wrapped, so that states can be averaged. The
model couples position and heading: the direction of motion determines the heading.

The model is from Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and
Navigation, section 11.7, written with the chord of the arc:
x += c·cos(yaw + w dt/2), y += c·sin(yaw + w dt/2), c = v dt·sin(w dt/2)/(w dt/2).
"""

from __future__ import annotations

import math

import numpy as np
from mecazen.geometry import Pose2D, Twist2D, wrap

from mecazen_follower.estimators.base import Array, Estimate

SIZE = 5
X, Y, YAW, V, W = range(SIZE)
SEEN = 3
"""Size of the observation: the first three components of the state."""

Walks = tuple[float, float, float, float, float]
"""Standard deviations of the random walks, see `process_noise`."""
State = tuple[float, ...]
"""A state (5) as plain floats: the overhead of NumPy would exceed the computation."""
Triangle = tuple[float, ...]
"""The upper triangle of a covariance (5, 5), row by row: 15 numbers."""
UPPER = np.triu_indices(SIZE)

IDENTITY: Array = np.eye(SIZE)
OBSERVATION: Array = np.eye(SEEN, SIZE)
"""The observation matrix H (3, 5)."""
SMALL_ANGLE = 1e-3
"""Angle [rad] below which the derivative of sin(a)/a is computed by its series."""


def arc(state: State, dt: float) -> tuple[float, ...]:
    """Return the displacement from `state` (5) in `dt` [s], and its partial derivatives.

    The result is x, y [m] and their derivatives by speed and turn rate: x_v, y_v, x_w, y_w. The
    derivative by the heading is (-y, x).
    """
    _, _, yaw, v, w = state
    half = w * dt / 2.0
    sinc = math.sin(half) / half if half else 1.0
    slope = -half / 3.0 if abs(half) < SMALL_ANGLE else (math.cos(half) - sinc) / half
    c, s = math.cos(yaw + half), math.sin(yaw + half)
    chord, bend = v * dt * sinc, v * dt * dt / 2.0
    return (
        chord * c,
        chord * s,
        dt * sinc * c,
        dt * sinc * s,
        bend * (slope * c - sinc * s),
        bend * (slope * s + sinc * c),
    )


def move(state: Array, dt: float) -> Array:
    """Return the state (5) after `dt` [s]."""
    x, y, yaw, v, w = state.tolist()
    dx, dy, *_ = arc((x, y, yaw, v, w), dt)
    return np.array([x + dx, y + dy, yaw + w * dt, v, w])


def jacobian(state: Array, dt: float) -> Array:
    """Return the Jacobian (5, 5) of `move` by the state."""
    dx, dy, x_v, y_v, x_w, y_w = arc(tuple(state.tolist()), dt)
    F = IDENTITY.copy()
    F[:SEEN, YAW:] = (-dy, x_v, x_w), (dx, y_v, y_w), (1.0, 0.0, dt)
    return F


def noise(walks: Walks, state: State, dt: float) -> tuple[float, ...]:
    """Return the entries of the upper triangle of `process_noise` that are not 0, row by row."""
    sway, step, heading, speed, rate = walks
    sway, step, heading = sway * sway * dt, step * step * dt, heading * heading * dt
    speed, rate = speed * speed * dt, rate * rate * dt
    _, _, yaw, v, _ = state
    position = sway * abs(v) + step
    c, s = math.cos(yaw), math.sin(yaw)
    way, ahead = speed * dt * dt / 3.0, speed * dt / 2.0
    return (
        *(position + way * c * c, way * c * s, ahead * c),
        *(position + way * s * s, ahead * s),
        *(heading + rate * dt * dt / 3.0, rate * dt / 2.0),
        speed,
        rate,
    )


def process_noise(walks: Walks, state: Array, dt: float) -> Array:
    """Return the covariance (5, 5) that random walks add in `dt` [s].

    Args:
        walks: Standard deviations of the random walks of the position (isotropic) after 1 m
            walked, and of position, heading, speed and turn rate after 1 s.
        state: The state (5) at which the random walks start.
        dt: Time [s]; the result is a first-order approximation in `dt`.
    """
    xx, xy, xv, yy, yv, aa, aw, vv, ww = noise(walks, tuple(state.tolist()), dt)
    return matrix((xx, xy, 0.0, xv, 0.0, yy, 0.0, yv, 0.0, aa, 0.0, aw, vv, 0.0, ww))


def matrix(covariance: Triangle) -> Array:
    """Return the symmetric matrix (5, 5) of an upper triangle."""
    P = np.empty((SIZE, SIZE))
    P[UPPER] = P.T[UPPER] = covariance
    return P


def triangle(covariance: Array) -> Triangle:
    """Return the upper triangle of a matrix (5, 5)."""
    return tuple(covariance[UPPER].tolist())


def propagate(
    state: State, covariance: Triangle, walks: Walks, dt: float, fading: float = 0.0
) -> tuple[State, Triangle]:
    """Return a state and its covariance P after `dt` [s]: `move`, and F P Fᵀ + Q.

    F is the `jacobian`, whose ones and zeros are not multiplied here, and Q the `process_noise`.
    After the motion the turn rate has decayed by exp(-fading dt). With `fading` [1/s] above 0 the
    turn rate is an Ornstein-Uhlenbeck process, which returns to 0 unless it is disturbed.
    """
    x, y, yaw, v, w = state
    xx, xy, xa, xv, xw, yy, ya, yv, yw, aa, av, aw, vv, vw, ww = covariance
    dx, dy, x_v, y_v, x_w, y_w = arc(state, dt)
    # the rows of F P that differ from P: x, y and a (heading)
    fxx = xx - dy * xa + x_v * xv + x_w * xw
    fxy = xy - dy * ya + x_v * yv + x_w * yw
    fxa = xa - dy * aa + x_v * av + x_w * aw
    fxv = xv - dy * av + x_v * vv + x_w * vw
    fxw = xw - dy * aw + x_v * vw + x_w * ww
    fyy = yy + dx * ya + y_v * yv + y_w * yw
    fya = ya + dx * aa + y_v * av + y_w * aw
    fyv = yv + dx * av + y_v * vv + y_w * vw
    fyw = yw + dx * aw + y_v * vw + y_w * ww
    faa, fav, faw = aa + dt * aw, av + dt * vw, aw + dt * ww
    # F P Fᵀ + Q
    qxx, qxy, qxv, qyy, qyv, qaa, qaw, qvv, qww = noise(walks, state, dt)
    k = math.exp(-fading * dt)
    return (x + dx, y + dy, yaw + w * dt, v, k * w), (
        fxx - dy * fxa + x_v * fxv + x_w * fxw + qxx,
        fxy + dx * fxa + y_v * fxv + y_w * fxw + qxy,
        fxa + dt * fxw,
        fxv + qxv,
        k * fxw,
        fyy + dx * fya + y_v * fyv + y_w * fyw + qyy,
        fya + dt * fyw,
        fyv + qyv,
        k * fyw,
        faa + dt * faw + qaa,
        fav,
        k * faw + qaw,
        vv + qvv,
        k * vw,
        k * k * ww + qww,
    )


def unwrap_yaw(yaw: float, observation: Pose2D) -> Array:
    """Return an observation (3) with its yaw unwrapped to within pi of `yaw`."""
    return np.array([observation.x, observation.y, yaw + wrap(observation.yaw - yaw)])


def estimate_of(state: State, covariance: Triangle) -> Estimate:
    """Return a state and its covariance as an estimate."""
    x, y, yaw, v, w = state
    xx, xy, xa, _, _, yy, ya, _, _, aa, *_ = covariance
    velocity = Twist2D(v * math.cos(yaw), v * math.sin(yaw), w)
    return Estimate(Pose2D(x, y, wrap(yaw)), velocity, ((xx, xy, xa), (xy, yy, ya), (xa, ya, aa)))
