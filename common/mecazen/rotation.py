"""Quaternions as arrays (..., 4) of x, y, z, w."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mecazen.portable import product

Array = npt.NDArray[np.float64]

_LEFT = np.array(
    [
        [0, 0, 0, 1, 0, 0, -1, 0, 0, 1, 0, 0, -1, 0, 0, 0],
        [0, 0, 1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0, -1, 0, 0],
        [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0],
        [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
    ],
    dtype=float,
)
"""For each of x, y, z, w the 4 x 4 matrix of its left multiplication."""


def about(axis: npt.ArrayLike, angle: npt.ArrayLike) -> Array:
    """Return rotations by angles [rad] (...) about unit axes (..., 3)."""
    half = np.asarray(angle, dtype=float)[..., np.newaxis] / 2.0
    return np.concatenate([np.sin(half) * np.asarray(axis), np.cos(half)], axis=-1)


def multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product (..., 4): first rotation `b`, then `a`."""
    matrices = product(a[..., np.newaxis, :], _LEFT).reshape(*a.shape[:-1], 4, 4)
    return product(matrices, b[..., np.newaxis])[..., 0]


def rotate(rotation: Array, vector: npt.ArrayLike) -> Array:
    """Return vectors (..., 3) rotated by quaternions (..., 4)."""
    vector = np.asarray(vector, dtype=float)
    pure = np.concatenate([vector, np.zeros((*vector.shape[:-1], 1))], axis=-1)
    conjugate = rotation * (-1.0, -1.0, -1.0, 1.0)
    turned: Array = multiply(multiply(rotation, pure), conjugate)[..., :3]
    return turned


def from_rpy(rpy: npt.ArrayLike) -> Array:
    """Return Rz(yaw)·Ry(pitch)·Rx(roll) of angles [rad] (..., 3)."""
    angles = np.asarray(rpy, dtype=float)
    roll, pitch, yaw = (about(np.eye(3)[axis], angles[..., axis]) for axis in range(3))
    return multiply(yaw, multiply(pitch, roll))
