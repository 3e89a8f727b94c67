"""Planar geometry for arrays of points, as in `geometry`."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mecazen.geometry import Pose2D

Floats = npt.NDArray[np.float64]


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


def to_rectangle(ahead: Floats, beside: Floats, half: tuple[float, float]) -> Floats:
    """Return the distances of points from a rectangle [m]: `geometry.to_rectangle`."""
    x, y = np.abs(ahead) - half[0], np.abs(beside) - half[1]
    inside = np.minimum(np.maximum(x, y), 0.0)
    distances: Floats = np.hypot(np.maximum(x, 0.0), np.maximum(y, 0.0)) + inside
    return distances
