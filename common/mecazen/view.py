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
    """Return why a point (3) from the optical centre, in base_link [m], is out of view, or None."""
    ahead, left, up = (
        math.fsum(a * v for a, v in zip(axis, vector, strict=True)) for axis in mount.axes
    )
    if abs(left) > math.tan(math.radians(camera.horizontal_fov_deg) / 2) * ahead:
        return Unseen.LEFT if left > 0.0 else Unseen.RIGHT
    if not camera.min_range_m <= ahead <= camera.max_range_m:
        return Unseen.TOO_FAR if ahead > camera.max_range_m else Unseen.TOO_NEAR
    if abs(up) > math.tan(math.radians(camera.vertical_fov_deg) / 2) * ahead:
        return Unseen.SHOULDERS if up > 0.0 else Unseen.BELOW
    return None
