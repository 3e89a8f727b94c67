"""Skeletons of a person who stands."""

from mecazen.geometry import Pose2D
from mecazen.messages import Point, Skeleton
from mecazen.skeleton import JOINTS

STANDING = {
    "pelvis": (0.0, 0.0, 0.95),
    "spine": (0.0, 0.0, 1.2),
    "neck": (0.0, 0.0, 1.45),
    "left_hip": (0.0, 0.1, 0.95),
    "right_hip": (0.0, -0.1, 0.95),
    "left_shoulder": (0.0, 0.2, 1.4),
    "right_shoulder": (0.0, -0.2, 1.4),
}
ELSEWHERE = (0.1, 0.0, 0.5)


def skeleton(pose: Pose2D, hidden=(), std: float = 0.01) -> Skeleton:
    """Return the skeleton of who stands at a pose, in which some joints are hidden."""
    joints = []
    for name in JOINTS:
        x, y, z = STANDING.get(name, ELSEWHERE)
        placed = pose.compose(Pose2D(x, y))
        joints.append(Point(placed.x, placed.y, z))
    confidence = tuple(0 if name in hidden else 2 for name in JOINTS)
    return Skeleton(id="7", joints=tuple(joints), std=(std,) * len(JOINTS), confidence=confidence)
