"""Geometry of arrays: planar points, and rotations in space as quaternions x, y, z, w."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mecazen.geometry import Pose2D
from mecazen.portable import Floats


def rotate(vectors: Floats, yaw: float) -> Floats:
    """Return vectors (..., 2 or 3) turned by `yaw` [rad] about the z axis."""
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = vectors[..., 0], vectors[..., 1]
    result = vectors.copy()
    result[..., 0], result[..., 1] = c * x - s * y, s * x + c * y
    return result


def compose(frame: Pose2D, xy: Floats) -> Floats:
    """Transform points (n, 2) [m] from a frame into its parent."""
    composed: Floats = rotate(xy, frame.yaw) + frame[:2]
    return composed


def between(frame: Pose2D, xy: Floats) -> Floats:
    """Transform points (n, 2) [m] from the parent of a frame into the frame."""
    return rotate(xy - frame[:2], -frame.yaw)


def to_rectangle(
    ahead: npt.ArrayLike, beside: npt.ArrayLike, half: tuple[npt.ArrayLike, npt.ArrayLike]
) -> Floats:
    """Return the distances of points from a rectangle [m]; inside, they are negative.

    Args:
        ahead: Coordinates along the length, from the middle of the rectangle [m].
        beside: The same along the width [m].
        half: Half the length and half the width of the rectangle, or of each of n [m].
    """
    x, y = np.abs(ahead) - half[0], np.abs(beside) - half[1]
    inside = np.minimum(np.maximum(x, y), 0.0)
    distances: Floats = np.hypot(np.maximum(x, 0.0), np.maximum(y, 0.0)) + inside
    return distances


def quaternions_about(axes: npt.ArrayLike, angles: npt.ArrayLike) -> Floats:
    """Return rotations (..., 4) by angles [rad] (...) about unit axes (..., 3)."""
    half = np.asarray(angles, dtype=float)[..., np.newaxis] / 2.0
    return np.concatenate([np.sin(half) * np.asarray(axes), np.cos(half)], axis=-1)


def quaternions_of_rpy(rpy: npt.ArrayLike) -> Floats:
    """Return Rz(yaw)·Ry(pitch)·Rx(roll) (..., 4) of angles [rad] (..., 3)."""
    angles = np.asarray(rpy, dtype=float)
    x, y, z = (quaternions_about(np.eye(3)[axis], angles[..., axis]) for axis in range(3))
    return chain(z, chain(y, x))


def chain(last: Floats, first: Floats) -> Floats:
    """Return the rotations (..., 4) that turn by `first`, then by `last`: the Hamilton product."""
    p, pw, q, qw = last[..., :3], last[..., 3:], first[..., :3], first[..., 3:]
    vector = pw * q + qw * p + _cross(p, q)
    return np.concatenate([vector, pw * qw - (p * q).sum(axis=-1, keepdims=True)], axis=-1)


def turn(quaternions: Floats, vectors: npt.ArrayLike) -> Floats:
    """Return vectors (..., 3) turned by quaternions (..., 4)."""
    q, w, v = quaternions[..., :3], quaternions[..., 3:], np.asarray(vectors, dtype=float)
    turned: Floats = v + 2.0 * _cross(q, _cross(q, v) + w * v)
    return turned


_YZX, _ZXY = [1, 2, 0], [2, 0, 1]


def _cross(a: Floats, b: Floats) -> Floats:
    """Return cross products (..., 3); `np.cross` takes several times as long for few vectors."""
    product: Floats = a[..., _YZX] * b[..., _ZXY] - a[..., _ZXY] * b[..., _YZX]
    return product
