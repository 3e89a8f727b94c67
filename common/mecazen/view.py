"""The view of a camera on a robot: which points it does not see, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mecazen.config.sensors import TrackerConfig
from mecazen.messages import Unseen
from mecazen.robot import CameraMount


def out_of_view(
    mount: CameraMount, camera: TrackerConfig, vector: Sequence[float]
) -> Unseen | None:
    """Return why a point is out of view; None if it is in view, hidden or not.

    `vector` (3) leads from the optical centre to the point, in base_link [m].
    """
    ahead, left, up = (
        math.fsum(a * v for a, v in zip(axis, vector, strict=True)) for axis in mount.axes
    )
    wide = math.tan(math.radians(camera.horizontal_fov_deg) / 2) * ahead
    high = math.tan(math.radians(camera.vertical_fov_deg) / 2) * ahead
    if abs(left) > wide:
        return Unseen.LEFT if left > 0.0 else Unseen.RIGHT
    if ahead > camera.max_range_m:
        return Unseen.TOO_FAR
    if ahead < camera.min_range_m:
        return Unseen.TOO_NEAR
    if abs(up) > high:
        return Unseen.SHOULDERS if up > 0.0 else Unseen.BELOW
    return None
