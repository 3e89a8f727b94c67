"""The body of a person as joints and limbs: one order, one hierarchy and one shape for all people.

Physics, sensors, viewer and scores all use this body, so a lidar hits what a robot touches. Names
follow `hri_msgs/Skeleton2D` (left_shoulder, right_knee, ...), which has no pelvis and no spine.
These two correspond to REP-155's links `waist` and `torso`: the root, and the middle of the trunk.
"""

from __future__ import annotations

from typing import NamedTuple

SIDES = ("left", "right")

_ARM = {"shoulder": "spine", "elbow": "shoulder", "wrist": "elbow"}
_LEG = {"hip": "pelvis", "knee": "hip", "ankle": "knee", "heel": "ankle", "foot": "ankle"}

PARENTS: dict[str, str | None] = {
    "pelvis": None,
    "spine": "pelvis",
    "neck": "spine",
    "head": "neck",
    **{
        f"{side}_{joint}": parent if parent in ("spine", "pelvis") else f"{side}_{parent}"
        for side in SIDES
        for joint, parent in {**_ARM, **_LEG}.items()
    },
}
"""The parent of each joint; `foot` is the ball of the foot, `heel` the sole below the heel bone."""

JOINTS = tuple(PARENTS)
"""All joints, in the order of every array of joints: 4 of the trunk, then 8 of each side."""

INDEX = {name: number for number, name in enumerate(JOINTS)}
"""The index of each joint in `JOINTS`."""

ANGLES = tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle"))
"""Joints whose sagittal angle is measured: flexion and dorsiflexion are positive [rad]."""


class Limb(NamedTuple):
    """A capsule between two joints; a sphere if both are the same joint."""

    name: str
    begin: str
    end: str
    radius: float
    """Radius as a share of the body's height."""


LIMBS = (
    Limb("trunk", "pelvis", "neck", 0.075),
    Limb("head", "head", "head", 0.06),
    *(
        Limb(f"{side}_{name}", f"{side}_{begin}", f"{side}_{end}", radius)
        for side in SIDES
        for name, begin, end, radius in (
            ("upper_arm", "shoulder", "elbow", 0.026),
            ("forearm", "elbow", "wrist", 0.022),
            ("thigh", "hip", "knee", 0.045),
            ("shank", "knee", "ankle", 0.03),
            ("foot", "heel", "foot", 0.018),
        )
    ),
)
"""The shape of a body: what sensors see and robots touch."""
