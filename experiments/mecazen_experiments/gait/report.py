"""A walk as a page beside the norm, and as files: curves over the gait cycle, strides, summary."""

from __future__ import annotations

import csv
import io
import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import msgspec
import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import ANGLES, SIDES
from mecazen_tools import files
from rich.console import RenderableType
from rich.table import Table
from scipy.interpolate import CubicSpline

from mecazen_experiments.capture import angles
from mecazen_experiments.gait import formats
from mecazen_experiments.gait.events import OFF_LATE_S, STRIKE_EARLY_S
from mecazen_experiments.gait.parameters import PARAMETERS, Gait, Parameter, Stride
from mecazen_experiments.gait.stages import RecordedWalk, Stage

PERCENT = np.arange(101.0)
"""Points of the gait cycle [%] at which curves have values."""
JOINTS = ("hip", "knee", "ankle")
NORM_NOTICE = (
    "Norm: derived (averaged) from Fukuchi, Fukuchi & Duarte, PeerJ 6:e4640, 2018, "
    "doi 10.6084/m9.figshare.5722711, CC BY 4.0"
)
HIDDEN_PERCENT = 90.0
"""Joints that are seen in a smaller share of the frames are listed."""
FAR = 2.0
"""Number of standard deviations from the norm beyond which values are marked with a star."""

GPS = "sagittal GPS (3 of 9 variables)"


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


class Curve(NamedTuple):
    """An angle of one side over the gait cycle [deg], at `PERCENT`."""

    mean: Floats
    sd: Floats
    """Standard deviation between strides; 0 for a single stride."""
    strides: int


def curves(stage: Stage) -> dict[tuple[str, str], Curve]:
    """Return the curves of a stage by side and joint; none without strides."""
    if not stage.strides:
        return {}
    degrees = angles(stage.joints)
    known = ~np.isnan(degrees).any(axis=1)
    by_place = {}
    for side in SIDES:
        spans = [(stride.start_s, stride.end_s) for stride in stage.strides if stride.side == side]
        times = [start + PERCENT / 100.0 * (end - start) for start, end in spans]
        for joint in JOINTS if spans else ():
            values = degrees[known, ANGLES.index(f"{side}_{joint}")]
            rows = [np.interp(cycle, stage.t[known], values) for cycle in times]
            by_place[side, joint] = Curve(np.mean(rows, axis=0), np.std(rows, axis=0), len(rows))
    return by_place


def variable_scores(by_place: Mapping[tuple[str, str], Curve]) -> dict[str, dict[str, float]]:
    """Return the gait variable scores (GVS) [deg] by side: of each joint, and their sagittal GPS.

    R. Baker et al., The Gait Profile Score and Movement Analysis Profile, Gait & Posture 30, 2009:
    root mean square distances from the norm at 51 points. The GPS needs nine variables; this one
    has the three sagittal angles.
    """
    scores = {}
    for side in SIDES:
        if (side, JOINTS[0]) in by_place:
            away = [by_place[side, joint].mean - norm_curve(joint) for joint in JOINTS]
            rms = [float(np.sqrt(np.mean(distance[::2] ** 2))) for distance in away]
            gps = math.sqrt(fmean(value**2 for value in rms))
            scores[side] = {**dict(zip(JOINTS, rms, strict=True)), GPS: gps}
    return scores


def report(walk: RecordedWalk, title: str) -> Iterator[RenderableType]:
    """Yield the output of `mecazen gait`."""
    yield f"[b]{title}, run {walk.run}, seed {walk.seed}[/]"
    yield (
        f"Seen from: {walk.view} ({walk.bearing_deg:.0f}° from straight ahead), "
        f"{walk.distance_m:.2f} m; a body in {walk.reported_percent:.0f} % of the frames"
    )
    hidden = {name: share for name, share in walk.seen_percent.items() if share < HIDDEN_PERCENT}
    listed = ", ".join(f"{name} {share:.0f} %" for name, share in hidden.items())
    yield f"Seen in less than {HIDDEN_PERCENT:g} % of the frames: {listed or 'no joint'}"
    refined = walk.stages.get("refined")
    gait = None if refined is None else refined.gait
    if refined is None or gait is None:
        yield "No stride was found."
        return
    numbers = {side: sum(stride.side == side for stride in refined.strides) for side in SIDES}
    counts = ", ".join(f"{number} {side}" for side, number in numbers.items())
    yield f"Strides: {counts}. * is farther than {FAR:g} SD from the norm."
    yield _parameters(walk, gait)
    for side, scores in variable_scores(curves(refined)).items():
        listed = ", ".join(f"{joint} {scores[joint]:.1f}°" for joint in JOINTS)
        yield f"{side}: GVS {listed}; {GPS} {scores[GPS]:.1f}°"
    yield f"[dim]{NORM_NOTICE}[/]"


def _parameters(walk: RecordedWalk, gait: Gait) -> Table:
    """Return the parameters of refined joints, with the deviations of filtered joints."""
    speed = gait.mean("speed_m_s")
    at = min(norm()["speeds"], key=lambda row: abs(row["speed_m_s"][0] - speed))
    filtered = walk.stages["filtered"].gait
    truth = walk.stages["truth"].gait if "truth" in walk.stages else None
    heads = [
        "left",
        "right",
        "asymmetry",
        "SD",
        *(["truth"] if truth else []),
        f"norm, {at['name']}",
    ]
    table = Table("", *heads, title="Parameters")
    for name, parameter in PARAMETERS.items():
        sd = None if filtered is None else filtered.sd(name)
        row = [
            f"{parameter.title} \\[{parameter.unit}]",
            _shown(gait.left[name].mean, parameter),
            _shown(gait.right[name].mean, parameter),
            f"{gait.asymmetry_percent(name):.1f} %",
            "" if sd is None else _shown(sd, parameter),
        ]
        if truth is not None:
            row.append(_shown(truth.mean(name), parameter))
        if name in at:
            mean, spread = at[name]
            far = "*" * (abs(gait.mean(name) - mean) > FAR * spread)
            row.append(f"{_shown(mean, parameter)} ± {_shown(spread, parameter)} {far}")
        table.add_row(*row)
    return table


def _shown(value: float, parameter: Parameter) -> str:
    return f"{parameter.scale * value:.{parameter.digits}f}"


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
    strides = [
        (name, *msgspec.structs.astuple(stride))
        for name, stage in stages.items()
        for stride in stage.strides
    ]
    points = [
        (name, *place, curve.strides, *(round(float(value), 4) for value in row))
        for name, by_place in by_stage.items()
        for place, curve in by_place.items()
        for row in zip(PERCENT, curve.mean, curve.sd, strict=True)
    ]
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
        "strides.csv": _csv(("stage", *Stride.__struct_fields__), strides),
        "curves.csv": _csv(
            ("stage", "side", "joint", "strides", "percent", "mean_deg", "sd_deg"), points
        ),
        "summary.json": msgspec.json.format(msgspec.json.encode(summary)).decode() + "\n",
    }
    for name, stage in stages.items():
        contents[f"{name}.trc"] = formats.trc(f"{name}.trc", stage.t, stage.joints)
    files.make_folder(folder, "--export")
    for name, content in contents.items():
        files.write(folder / name, content.encode(), "--export")
    written = [folder / name for name in contents]
    for name, stage in stages.items() if find_spec("ezc3d") else ():
        save = partial(formats.write_c3d, t=stage.t, joints=stage.joints, events=stage.events)
        written.append(folder / f"{name}.c3d")
        files.write_with(written[-1], save, "--export")
    return written


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([head, *rows])
    return text.getvalue()
