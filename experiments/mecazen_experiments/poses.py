"""Planar poses of many ticks at once: `mecazen.geometry` for arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D

Floats = npt.NDArray[np.float64]


def wrap(angles: Floats) -> Floats:
    """Return `angles` [rad] brought into [-pi, pi]."""
    return angles - np.rint(angles / np.pi / 2.0) * np.pi * 2.0


class Poses(NamedTuple):
    """Planar poses: x, y [m], yaw [rad], one of each for a tick, in one frame."""

    x: Floats
    y: Floats
    yaw: Floats

    def at(self, tick: int) -> Pose2D:
        """Return the pose in one row."""
        return Pose2D(float(self.x[tick]), float(self.y[tick]), float(self.yaw[tick]))

    def compose(self, other: Poses | Pose2D) -> Poses:
        """Return `other`, given in these frames, in their parent."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return Poses(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            wrap(self.yaw + other.yaw),
        )

    def between(self, other: Poses) -> Poses:
        """Return `other`, given in these frames' parent, in these frames."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        dx, dy = other.x - self.x, other.y - self.y
        return Poses(c * dx + s * dy, -s * dx + c * dy, wrap(other.yaw - self.yaw))
