"""Quaternions as arrays (..., 4) of x, y, z, w."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def about(axis: npt.ArrayLike, angle: npt.ArrayLike) -> Array:
    """Return rotations by angles [rad] (...) about unit axes (..., 3)."""
    half = np.asarray(angle, dtype=float)[..., np.newaxis] / 2.0
    return np.concatenate([np.sin(half) * np.asarray(axis), np.cos(half)], axis=-1)


def multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product: rotations `b`, then `a` (..., 4)."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def from_rpy(rpy: npt.ArrayLike) -> Array:
    """Return Rz(yaw)·Ry(pitch)·Rx(roll) of angles [rad] (..., 3)."""
    angles = np.asarray(rpy, dtype=float)
    roll, pitch, yaw = (about(np.eye(3)[axis], angles[..., axis]) for axis in range(3))
    return multiply(yaw, multiply(pitch, roll))
