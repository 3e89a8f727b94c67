"""From the joints of a body to the person's position and heading."""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D
from mecazen.messages import PlanarCovariance, Skeleton
from mecazen.skeleton import INDEX

from mecazen_follower.measurement import NO_HEADING

_TRUNK = tuple(INDEX[name] for name in ("pelvis", "spine", "neck"))
_LINES = tuple((INDEX[f"left_{joint}"], INDEX[f"right_{joint}"]) for joint in ("hip", "shoulder"))
"""Joints that lie across the direction in which the person faces."""

SWAY_STD_M = 0.015
"""Sway of a trunk about the person's path: M. S. Orendurff et al., J. Rehabil. Res. Dev. 41, 2004,
4 to 7 cm from side to side."""
TWIST_STD_RAD = math.radians(4.0)
"""Twist of pelvis and shoulders about the walking direction: once a stride, in opposition."""
LEAST_STD_M = 1e-4
"""Minimum standard deviation: a tracker that reports no error still has its resolution [m]."""
PLACE_CORRELATED, HEADING_CORRELATED = 25.0, 25.0
"""Factors on the variances of one frame: most of a tracker's error persists for many frames, but
the filter assumes independent errors. The factors were tuned by the NEES of the U-track."""


def pose_of(body: Skeleton) -> tuple[Pose2D, PlanarCovariance] | None:
    """Return the pose of a person in the frame of a skeleton, and its covariance.

    The trunk's joints are above each other, at the person's position. The lines through hips and
    shoulders are at right angles to the heading; each line is weighted by its inverse variance.
    Without a line the heading's variance is `NO_HEADING`.

    Returns:
        None if no joint of the trunk is in view.
    """
    seen = [at for at in _TRUNK if body.confidence[at]]
    if not seen:
        return None
    weights = [1.0 / max(body.std[at], LEAST_STD_M) ** 2 for at in seen]
    total = math.fsum(weights)
    x = math.fsum(w * body.joints[at].x for w, at in zip(weights, seen, strict=True)) / total
    y = math.fsum(w * body.joints[at].y for w, at in zip(weights, seen, strict=True)) / total
    variance = PLACE_CORRELATED / total + SWAY_STD_M**2
    yaw, yaw_variance = _heading(body)
    return Pose2D(x, y, yaw), ((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, yaw_variance))


def _heading(body: Skeleton) -> tuple[float, float]:
    """Return the heading [rad] and its variance [rad²]."""
    ahead = left = total = 0.0
    for one, other in _LINES:
        if not (body.confidence[one] and body.confidence[other]):
            continue
        dx = body.joints[one].x - body.joints[other].x
        dy = body.joints[one].y - body.joints[other].y
        length = math.hypot(dx, dy)
        across = body.std[one] ** 2 + body.std[other] ** 2
        if length * length <= across:
            continue  # too short for a direction
        weight = 1.0 / (HEADING_CORRELATED * across / length**2 + TWIST_STD_RAD**2)
        ahead, left = ahead + weight * dy / length, left - weight * dx / length
        total += weight
    if total == 0.0:
        return 0.0, NO_HEADING
    return math.atan2(left, ahead), 1.0 / total
