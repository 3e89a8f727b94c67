"""Files of gait laboratories: TRC and MOT of OpenSim, and C3D (https://www.c3d.org)."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np
from mecazen.skeleton import ANGLES, INDEX, JOINTS
from mecazen_people.body.posture import PELVIS_TILT
from mecazen_tools.table import Floats
from scipy.spatial.transform import Rotation

from mecazen_experiments.gait.events import Events

NAMES = {"pelvis": "Hip", "spine": "Spine", "neck": "Neck", "head": "Head", "foot": "Ball"}
"""Names of joints that differ from Pose2Sim's HALPE_26, which has toes but no balls, and no
spine."""
BLOCK = 512
INTEL = 84
PARAMETER_BLOCK = 2
"""The block of a C3D file at which its parameters begin, counted from 1."""
OPENSIM = {"hip": "hip_flexion", "knee": "knee_angle", "ankle": "ankle_angle"}


def marker(joint: str) -> str:
    """Return the name of a joint's marker."""
    side, _, name = joint.rpartition("_")
    return side[:1].upper() + NAMES.get(name, name.capitalize())


MARKERS = tuple(marker(joint) for joint in JOINTS)


def y_up(joints: Floats) -> Floats:
    """Transform points (..., 3) from a frame with z up to a frame with y up and the same x."""
    x, y, z = np.moveaxis(joints, -1, 0)
    return np.stack((x, z, -y), axis=-1)


def trc(name: str, t: Floats, joints: Floats) -> bytes:
    """Return a TRC file of joints (n, 20, 3) [m] at times t (n,) [s], y up; missing: `nan`."""
    rate, n = f"{1.0 / float(np.mean(np.diff(t))):.2f}", len(MARKERS)
    keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
    lines = [
        ("PathFileType", "4", "(X/Y/Z)", name),
        (*keys.split(), "OrigNumFrames"),
        (rate, rate, str(len(t)), str(n), "m", rate, "1", str(len(t))),
        ("Frame#", "Time", *(cell for name in MARKERS for cell in (name, "", ""))),
        ("", "", *(f"{axis}{i}" for i in range(1, n + 1) for axis in "XYZ")),
        (),
    ]
    rows = y_up(joints).reshape(len(t), -1).tolist()
    for frame, (time, row) in enumerate(zip(t.tolist(), rows, strict=True), start=1):
        lines.append((str(frame), f"{time:.5f}", *(f"{value:.6f}" for value in row)))
    return "".join("\t".join(line) + "\n" for line in lines).encode()


def mot(t: Floats, joints: Floats, angles: Floats) -> bytes:
    """Return a MOT file of pelvis and sagittal angles (n, 6) [deg], with OpenSim's names."""
    columns = {
        **{f"pelvis_{axis}": y_up(joints[:, 0])[:, i] for i, axis in enumerate(("tx", "ty", "tz"))},
        **dict(
            zip(("pelvis_tilt", "pelvis_list", "pelvis_rotation"), _pelvis(joints), strict=True)
        ),
    }
    for name, values in zip(ANGLES, angles.T, strict=True):
        side, joint = name.split("_")
        columns[f"{OPENSIM[joint]}_{side[0]}"] = values
    head = (
        "Coordinates",
        "version=1",
        f"nRows={len(t)}",
        f"nColumns={len(columns) + 1}",
        "inDegrees=yes",
        "",
        "Flexion and dorsiflexion are positive, also of the knee, which gait2392 counts negative.",
        f"The pelvis is tilted forward by {math.degrees(PELVIS_TILT):g} deg from the trunk.",
        "endheader",
        "\t".join(("time", *columns)),
    )
    table = np.column_stack((t, *columns.values())).tolist()
    rows = ("\t".join(f"{value:.6f}" for value in row) for row in table)
    return "".join(f"{line}\n" for line in (*head, *rows)).encode()


def _pelvis(joints: Floats) -> Floats:
    """Return tilt, list and rotation (3, n) [deg] of the pelvis in OpenSim's order."""
    hips = y_up(joints[:, INDEX["right_hip"]] - joints[:, INDEX["left_hip"]])
    trunk = y_up(joints[:, INDEX["spine"]] - joints[:, INDEX["pelvis"]])
    forward = np.cross(trunk, hips)
    axes = np.stack((forward, np.cross(hips, forward), hips), axis=-1)
    axes /= np.linalg.norm(axes, axis=-2, keepdims=True)
    found = np.full((len(joints), 3), np.nan)
    known = ~np.isnan(axes).any(axis=(1, 2))
    if known.any():
        tilted = Rotation.from_matrix(axes[known]) * Rotation.from_euler("z", -PELVIS_TILT)
        found[known] = tilted.as_euler("ZXY", degrees=True)
    return found.T


def c3d(t: Floats, joints: Floats, events: Events | None) -> bytes:
    """Return joints (n, 20, 3) [m] and events as C3D: z up, in mm, missing points with residual -1.

    The first frame is at time 0, so the times of events are relative to this frame.
    """
    n, rate = len(t), 1.0 / float(np.mean(np.diff(t)))
    found = sorted(
        (float(time - t[0]), side, label)
        for label, both in zip(("Foot Strike", "Foot Off"), events or ((), ()), strict=True)
        for side, times in zip(("Left", "Right"), both, strict=False)
        for time in times
    )
    if len(found) > 255:
        found = found[:255]  # a dimension of a parameter is a byte
    times, sides, labels = zip(*found, strict=True) if found else ((), (), ())
    minutes = [(math.floor(time / 60.0), time % 60.0) for time in times]
    groups = {
        "POINT": {
            "USED": _integers(len(MARKERS)),
            "SCALE": _floats([-1.0]),
            "RATE": _floats([rate]),
            "DATA_START": b"",
            "FRAMES": _integers(min(n, 65535)),
            "LABELS": _texts(MARKERS),
            "DESCRIPTIONS": _texts(JOINTS),
            "UNITS": _texts(["mm"]),
        },
        "ANALOG": {"USED": _integers(0), "RATE": _floats([rate]), "GEN_SCALE": _floats([1.0])},
        "FORCE_PLATFORM": {"USED": _integers(0)},
        "EVENT": {
            "USED": _integers(len(found)),
            "TIMES": _floats(minutes, 2, len(found)),
            "CONTEXTS": _texts(sides),
            "LABELS": _texts(labels),
            "ICON_IDS": _integers(
                *(2 if label == "Foot Off" else 1 for label in labels), many=True
            ),
        },
    }
    blocks = -(-len(_section(groups, 0, 0)) // BLOCK)
    start = PARAMETER_BLOCK + blocks
    header = struct.pack(
        "<BBHHHHHfHHf",
        PARAMETER_BLOCK,
        0x50,
        len(MARKERS),
        0,
        1,
        min(n, 65535),
        0,
        -1.0,
        start,
        0,
        rate,
    )
    missing = np.asarray(np.isnan(joints).any(axis=-1))
    values = np.zeros((n, len(MARKERS), 4), "<f4")
    values[..., :3] = np.where(missing[..., None], 0.0, 1e3 * joints)
    values[..., 3] = np.where(missing, -1.0, 0.0)
    section = _section(groups, start, blocks).ljust(blocks * BLOCK, b"\0")
    data = values.tobytes()
    return header.ljust(BLOCK, b"\0") + section + data.ljust(-(-len(data) // BLOCK) * BLOCK, b"\0")


def _section(groups: dict[str, dict[str, bytes]], start: int, blocks: int) -> bytes:
    """Return the section of parameters; `start` is the first block of the data."""
    records = []
    for number, (group, parameters) in enumerate(groups.items(), start=1):
        records.append((group, -number, b""))
        for name, value in parameters.items():
            content = _integers(start) if name == "DATA_START" else value
            records.append((name, number, content))
    section = bytes((1, 0x50, blocks, INTEL))
    for name, number, content in records:
        # the offset counts from itself to the next record; a description of length 0 ends a record
        offset = 2 + len(content) + 1
        section += struct.pack("<bb", len(name), number) + name.encode()
        section += struct.pack("<H", offset) + content + b"\0"
    return section + b"\0\0"


def _integers(*values: int, many: bool = False) -> bytes:
    sizes = bytes((1, len(values))) if many else b"\0"
    return b"\2" + sizes + np.array(values, "<u2").tobytes()


def _floats(values: Sequence[object], *sizes: int) -> bytes:
    return bytes((4, len(sizes), *sizes)) + np.array(values, "<f4").tobytes()


def _texts(texts: Sequence[str]) -> bytes:
    width = max(map(len, texts), default=1)
    content = "".join(text.ljust(width) for text in texts).encode()
    return struct.pack("<bBBB", -1, 2, width, len(texts)) + content
