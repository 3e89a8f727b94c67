"""Files of gait laboratories: TRC of OpenSim, and C3D (https://www.c3d.org)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import JOINTS

from mecazen_experiments.gait.events import Events

NAMES = {"pelvis": "Hip", "spine": "Spine", "neck": "Neck", "head": "Head", "foot": "Ball"}
"""Names of joints that differ from Pose2Sim's HALPE_26, which has toes but no balls, and no
spine."""
MAX_EVENTS = 255
"""Maximum number of events in a C3D file, in which the length of a list is a byte."""
TRC_HEAD = """PathFileType\t4\t(X/Y/Z)\t{name}
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
{rate:.2f}\t{rate:.2f}\t{frames}\t{markers}\tm\t{rate:.2f}\t1\t{frames}
"""


def _marker(joint: str) -> str:
    side, _, name = joint.rpartition("_")
    return side[:1].upper() + NAMES.get(name, name.capitalize())


MARKERS = tuple(map(_marker, JOINTS))


def y_up(joints: Floats) -> Floats:
    """Transform points (..., 3) from a frame with z up to a frame with y up and the same x."""
    x, y, z = np.moveaxis(joints, -1, 0)
    return np.stack((x, z, -y), axis=-1)


def trc(name: str, t: Floats, joints: Floats) -> str:
    """Return a TRC file of joints (n, 20, 3) [m] at times t (n,) [s], y up; missing: `nan`."""
    rate = 1.0 / float(np.mean(np.diff(t)))
    axes = [f"{axis}{n}" for n in range(1, len(MARKERS) + 1) for axis in "XYZ"]
    lines = [
        ("Frame#", "Time", *(cell for name in MARKERS for cell in (name, "", ""))),
        ("", "", *axes),
        (),
    ]
    rows = y_up(joints).reshape(len(t), -1).tolist()
    for frame, (time, row) in enumerate(zip(t.tolist(), rows, strict=True), start=1):
        lines.append((str(frame), f"{time:.5f}", *(f"{value:.6f}" for value in row)))
    head = TRC_HEAD.format(name=name, rate=rate, frames=len(t), markers=len(MARKERS))
    return head + "".join("\t".join(line) + "\n" for line in lines)


def write_c3d(file: Path, t: Floats, joints: Floats, events: Events | None) -> None:
    """Write joints (n, 20, 3) [m] and events as C3D: z up, in mm, missing points with residual -1.

    The first frame is at time 0, so the times of events are relative to this frame.

    Raises:
        ImportError: The library ezc3d is missing.
    """
    import ezc3d  # noqa: PLC0415  # an extra

    content = ezc3d.c3d()
    points = content["parameters"]["POINT"]
    points["LABELS"]["value"], points["DESCRIPTIONS"]["value"] = list(MARKERS), list(JOINTS)
    points["UNITS"]["value"], points["RATE"]["value"] = ["mm"], [1.0 / float(np.mean(np.diff(t)))]
    missing = np.any(np.isnan(joints), axis=-1)
    places = 1e3 * np.where(missing[..., None], 0.0, joints)
    content["data"]["points"] = np.concatenate((places.T, np.ones((1, *missing.T.shape))))
    content["data"]["meta_points"]["residuals"] = np.where(missing.T, -1.0, 0.0)[np.newaxis]
    rows = sorted(
        (float(time - t[0]), side, label)
        for label, feet in zip(("Foot Strike", "Foot Off"), events or (), strict=False)
        for side, times in zip(("Left", "Right"), feet, strict=True)
        for time in times
    )[:MAX_EVENTS]
    content.add_parameter("EVENT", "USED", [len(rows)])
    if rows:
        times, sides, labels = zip(*rows, strict=True)
        content.add_parameter("EVENT", "TIMES", np.array(np.divmod(times, 60.0)))
        content.add_parameter("EVENT", "CONTEXTS", list(sides))
        content.add_parameter("EVENT", "LABELS", list(labels))
    content.write(str(file))
