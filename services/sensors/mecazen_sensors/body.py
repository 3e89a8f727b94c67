"""A body tracker's model of bodies: limbs that show a joint, and legs that can be confused."""

from __future__ import annotations

import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import INDEX, JOINTS, LIMBS, PARENTS

FOREIGN = len(LIMBS)
"""Stands for everything except the person's own limbs."""
_LEG = ("knee", "ankle", "heel", "foot")


def _opposite(name: str) -> str:
    side, _, joint = name.rpartition("_")
    return {"left": "right_", "right": "left_", "": ""}[side] + joint


def scales(table: dict[str, float]) -> Floats:
    """Return a factor for each joint (20,), by its name without the side; 1 by default."""
    return np.array([table.get(name.rpartition("_")[2], 1.0) for name in JOINTS])


MIRRORED = [INDEX[_opposite(name)] for name in JOINTS]
"""For each joint the joint of the other side."""
LEGS_SWAPPED = [
    INDEX[_opposite(name)] if name.endswith(_LEG) else number for number, name in enumerate(JOINTS)
]
"""For each joint the joint that is reported instead if the legs are confused; hips are never
confused."""
IS_LEG: Floats = np.array([float(name.endswith(_LEG)) for name in JOINTS])
"""1 for each joint of a leg (20,)."""


def _own(name: str) -> frozenset[int]:
    # the pelvis lies between the thighs, hips and spine in the trunk, the ankle above the foot
    inner = {"pelvis": ("left_hip", "right_hip"), "spine": ("pelvis",)}.get(name, ())
    if name.endswith("hip"):
        inner = ("pelvis",)
    if name.endswith("ankle"):
        inner = (name.replace("ankle", "foot"),)
    names = {name, *inner}
    return frozenset(n for n, limb in enumerate(LIMBS) if names & {limb.begin, limb.end})


OWN = [_own(name) for name in JOINTS]
"""For each joint the numbers of the limbs that make it visible if a ray to the joint hits them
first."""


def _of_other_leg(name: str) -> frozenset[int]:
    if not name.endswith(("knee", "ankle")):
        return frozenset()
    knee = _opposite(f"{name.rpartition('_')[0]}_knee")
    return frozenset(n for n, limb in enumerate(LIMBS) if knee in {limb.begin, limb.end})


OTHER_LEG = [_of_other_leg(name) for name in JOINTS]
"""For knees and ankles the numbers of the other leg's thigh and shank."""


def _chains() -> Floats:
    chains = np.zeros((len(JOINTS), len(JOINTS)))
    for number, name in enumerate(JOINTS):
        ancestor: str | None = name
        while ancestor is not None:
            chains[number, INDEX[ancestor]] = 1.0
            ancestor = PARENTS[ancestor]
    return chains


CHAINS: Floats = _chains()
"""Matrix (20, 20) from bones to joints: a bone ends in the joint of its number."""
_BONES: Floats = np.eye(len(JOINTS))
for _number, _name in enumerate(JOINTS):
    if (_parent := PARENTS[_name]) is not None:
        _BONES[_number, INDEX[_parent]] = -1.0
BONES: Floats = _BONES[MIRRORED] - _BONES
"""Matrix (20, 20) from joints to the differences of the other side's bones from their own."""
