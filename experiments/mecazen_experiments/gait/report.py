"""A walk as a page beside the norm, and as files of gait laboratories: TRC, C3D, CSV and JSON."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import fmean
from typing import Any

import msgspec
import numpy as np
import pandas as pd
from mecazen.portable import Floats
from mecazen.skeleton import ANGLES, JOINTS
from mecazen_tools import files
from rich.console import RenderableType
from rich.table import Table
from scipy.interpolate import CubicSpline

from mecazen_experiments.gait.motion import MEASURED, angles
from mecazen_experiments.gait.stages import Stage
from mecazen_experiments.gait.strides import OFF_LATE_S, PARAMETERS, STRIKE_EARLY_S, Events, Gait

PERCENT = np.arange(101.0)
"""Points of the gait cycle [%] at which curves have values."""
NORM_NOTICE = (
    "Norm: derived (averaged) from Fukuchi, Fukuchi & Duarte, PeerJ 6:e4640, 2018, "
    "doi 10.6084/m9.figshare.5722711, CC BY 4.0"
)
HIDDEN_PERCENT = 90.0
"""Joints that are seen in a smaller share of the frames are listed."""
FAR = 2.0
"""Number of standard deviations from the norm beyond which values are marked with a star."""
GPS = "sagittal GPS (3 of 9 variables)"

NAMES = {"pelvis": "Hip", "foot": "Ball"}
"""Names of joints that differ from Pose2Sim's HALPE_26, which has toes but no balls, and no
spine."""
MARKERS = [
    side[:1].upper() + NAMES.get(name, name.capitalize())
    for side, _, name in (joint.rpartition("_") for joint in JOINTS)
]
MAX_EVENTS = 255
"""Maximum number of events in a C3D file, in which the length of a list is a byte."""
TRC_HEAD = """PathFileType\t4\t(X/Y/Z)\t{name}
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
{rate:.2f}\t{rate:.2f}\t{frames}\t{markers}\tm\t{rate:.2f}\t1\t{frames}
"""


@cache
def norm() -> dict[str, Any]:
    """Return the norm by Fukuchi et al.: means and SD of parameters, and curves [deg], by speed."""
    return tomllib.loads(Path(__file__).with_name("fukuchi.toml").read_text("utf-8"))


def norm_curve(joint: str) -> Floats:
    """Return the mean angle of healthy adults at `PERCENT` (101,) [deg]: a periodic spline."""
    percent, values = norm()["curves"]["percent"], norm()["curves"]["deg"][joint]
    spline = CubicSpline([*percent, 100.0], [*values, values[0]], bc_type="periodic")
    curve: Floats = spline(PERCENT)
    return curve


def curves(stage: Stage) -> pd.DataFrame | None:
    """Return the mean curves of a stage and their deviations over strides; None without strides.

    There is a row for each side, joint and point of `PERCENT`.
    """
    if stage.strides is None:
        return None
    degrees = angles(stage.joints)
    known = ~np.isnan(degrees).any(axis=1)
    parts = []
    for side, rows in stage.strides.groupby("side"):
        spans = rows[["start_s", "end_s"]].to_numpy()
        times = [start + PERCENT / 100.0 * (end - start) for start, end in spans]
        for joint in MEASURED:
            values = degrees[known, ANGLES.index(f"{side}_{joint}")]
            strides = [np.interp(cycle, stage.t[known], values) for cycle in times]
            place = {"side": side, "joint": joint, "strides": len(strides), "percent": PERCENT}
            mean, sd = np.mean(strides, axis=0), np.std(strides, axis=0)
            parts.append(pd.DataFrame({**place, "mean_deg": mean, "sd_deg": sd}))
    return pd.concat(parts, ignore_index=True)


def variable_scores(curves: pd.DataFrame | None) -> dict[str, dict[str, float]]:
    """Return the gait variable scores (GVS) [deg] by side: of each joint, and their sagittal GPS.

    R. Baker et al., The Gait Profile Score and Movement Analysis Profile, Gait & Posture 30, 2009:
    root mean square distances from the norm at 51 points. The GPS needs nine variables; this one
    has the three sagittal angles.
    """
    scores: dict[str, dict[str, float]] = {}
    places = () if curves is None else curves.groupby(["side", "joint"], sort=False)
    for (side, joint), curve in places:
        away = curve["mean_deg"].to_numpy() - norm_curve(joint)
        scores.setdefault(side, {})[joint] = float(np.sqrt(np.mean(away[::2] ** 2)))
    for values in scores.values():
        values[GPS] = math.sqrt(fmean(value**2 for value in values.values()))
    return scores


def report(stages: Mapping[str, Stage], about: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Yield the output of `mecazen gait`, of what `read_walk` returns and the recording's name."""
    yield "[b]{recording}, run {run}, seed {seed}[/]".format(**about)
    reported = 1e2 * float(np.mean(~np.isnan(stages["raw"].joints[:, 0, 0])))
    yield (
        f"Seen from: {about['view']} ({about['bearing_deg']:.0f}° from straight ahead), "
        f"{about['distance_m']:.2f} m; a body in {reported:.0f} % of the frames"
    )
    hidden = {
        name: share for name, share in about["seen_percent"].items() if share < HIDDEN_PERCENT
    }
    listed = ", ".join(f"{name} {share:.0f} %" for name, share in hidden.items())
    yield f"Seen in less than {HIDDEN_PERCENT:g} % of the frames: {listed or 'no joint'}"
    refined = stages.get("refined")
    gait = None if refined is None else refined.gait
    if refined is None or gait is None:
        yield "No stride was found."
        return
    left, right = (spreads["speed_m_s"].strides for spreads in (gait.left, gait.right))
    yield f"Strides: {left} left, {right} right. * is farther than {FAR:g} SD from the norm."
    yield _parameters(stages, gait)
    for side, scores in variable_scores(curves(refined)).items():
        listed = ", ".join(f"{joint} {scores[joint]:.1f}°" for joint in MEASURED)
        yield f"{side}: GVS {listed}; {GPS} {scores[GPS]:.1f}°"
    yield f"[dim]{NORM_NOTICE}[/]"


def _parameters(stages: Mapping[str, Stage], gait: Gait) -> Table:
    """Return the parameters of refined joints, with the deviations of filtered joints."""
    speed = gait.mean("speed_m_s")
    at = min(norm()["speeds"], key=lambda row: abs(row["speed_m_s"][0] - speed))
    filtered = stages["filtered"].gait
    truth = stages["truth"].gait if "truth" in stages else None
    heads = ["left", "right", "asymmetry", "SD", *(["truth"] if truth else [])]
    table = Table("", *heads, f"norm, {at['name']}", title="Parameters")
    for name, (title, unit, scale, digits) in PARAMETERS.items():
        values = [
            gait.left[name].mean,
            gait.right[name].mean,
            None if filtered is None else filtered.sd(name),
            *([truth.mean(name)] if truth else []),
        ]
        cells = ["" if value is None else f"{scale * value:.{digits}f}" for value in values]
        cells.insert(2, f"{gait.asymmetry_percent(name):.1f} %")
        if name in at:
            mean, spread = (f"{scale * value:.{digits}f}" for value in at[name])
            far = "*" * (abs(gait.mean(name) - at[name][0]) > FAR * at[name][1])
            cells.append(f"{mean} ± {spread} {far}")
        table.add_row(f"{title} \\[{unit}]", *cells)
    return table


def export(folder: Path, stages: Mapping[str, Stage], about: Mapping[str, Any]) -> list[Path]:
    """Write a walk into a folder, which is created if needed; return the files.

    The files of each stage are markers (.trc), and with ezc3d markers with events (.c3d).
    `strides.csv` has a row for each stride, `curves.csv` angles at 101 points, and `summary.json`
    all parameters.

    Args:
        folder: Where to write.
        stages: As `seen_stages` and `true_stage` return them, by their names.
        about: Information on the walk and the view, for the summary.

    Raises:
        MecazenError: A file can't be written.
    """
    by_stage = {name: curves(stage) for name, stage in stages.items()}
    rounded = {name: None if rows is None else rows.round(4) for name, rows in by_stage.items()}
    summary = {
        **about,
        "software": f"mecazen {version('mecazen')}",
        "events": "truth: planted feet; others: Zeni et al. 2008, less their mean errors",
        "strike_early_s": STRIKE_EARLY_S,
        "off_late_s": OFF_LATE_S,
        "norm": NORM_NOTICE,
        "stages": {
            name: {
                "rate_hz": round(1.0 / float(np.mean(np.diff(stage.t))), 6),
                "frames": len(stage.t),
                "parameters": stage.gait,
                "gait_variable_scores_deg": variable_scores(by_stage[name]),
            }
            for name, stage in stages.items()
        },
    }
    contents = {
        "strides.csv": _csv({name: stage.strides for name, stage in stages.items()}),
        "curves.csv": _csv(rounded),
        "summary.json": msgspec.json.format(msgspec.json.encode(summary)).decode() + "\n",
    }
    for name, stage in stages.items():
        contents[f"{name}.trc"] = trc(f"{name}.trc", stage.t, stage.joints)
    files.make_folder(folder, "--export")
    for name, content in contents.items():
        files.write(folder / name, content.encode(), "--export")
    written = [folder / name for name in contents]
    for name, stage in stages.items() if find_spec("ezc3d") else ():
        save = partial(write_c3d, t=stage.t, joints=stage.joints, events=stage.events)
        written.append(folder / f"{name}.c3d")
        files.write_with(written[-1], save, "--export")
    return written


def _csv(by_stage: Mapping[str, pd.DataFrame | None]) -> str:
    """Return the rows of all stages after the stage's name."""
    frames = {name: rows for name, rows in by_stage.items() if rows is not None}
    if not frames:
        return "stage\n"
    text: str = pd.concat(frames, names=["stage"]).reset_index("stage").to_csv(index=False)
    return text


def trc(name: str, t: Floats, joints: Floats) -> str:
    """Return a TRC file of joints (n, 20, 3) [m] at times t (n,) [s], y up; missing: `nan`."""
    rate = 1.0 / float(np.mean(np.diff(t)))
    axes = [f"{axis}{n}" for n in range(1, len(MARKERS) + 1) for axis in "XYZ"]
    lines = [
        ("Frame#", "Time", *(cell for name in MARKERS for cell in (name, "", ""))),
        ("", "", *axes),
        (),
    ]
    x, y, z = np.moveaxis(joints, -1, 0)
    rows = np.stack((x, z, -y), axis=-1).reshape(len(t), -1).tolist()
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
    points["LABELS"]["value"], points["DESCRIPTIONS"]["value"] = MARKERS, list(JOINTS)
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
