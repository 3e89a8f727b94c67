"""Exports a walk to file formats of gait laboratories."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mecazen_tools import files

from mecazen_experiments.capture import angles
from mecazen_experiments.gait import formats
from mecazen_experiments.gait.curves import NORM_NOTICE, PERCENT, curves, variable_scores
from mecazen_experiments.gait.events import OFF_LATE_S, STRIKE_EARLY_S
from mecazen_experiments.gait.parameters import PARAMETERS, Gait, Stride
from mecazen_experiments.gait.stages import Stage


def export(folder: Path, stages: Mapping[str, Stage], about: Mapping[str, Any]) -> list[Path]:
    """Write a walk into a folder, which is created if needed; return the files.

    The files of each stage are markers (.trc), joint angles (.mot), and markers with events (.c3d).
    `strides.csv` has a row for each stride, `curves.csv` angles at 101 points, and `summary.json`
    all parameters.

    Args:
        folder: Where to write.
        stages: As `seen_stages` and `true_stage` return them, by their names.
        about: Information on the walk and the view, for the summary.

    Raises:
        MecazenError: A file can't be written.
    """
    contents: dict[str, bytes] = {}
    for name, stage in stages.items():
        known = ~np.isnan(stage.joints).any(axis=(1, 2))
        joints = stage.joints[known]
        contents[f"{name}.trc"] = formats.trc(f"{name}.trc", stage.t, stage.joints)
        contents[f"{name}.mot"] = formats.mot(stage.t[known], joints, angles(joints))
        contents[f"{name}.c3d"] = formats.c3d(stage.t, stage.joints, stage.events)
    contents["strides.csv"] = _table(
        ("stage", *Stride.__struct_fields__),
        [
            (name, *msgspec.structs.astuple(stride))
            for name, stage in stages.items()
            for stride in stage.strides
        ],
    )
    by_stage = {name: curves(stage) for name, stage in stages.items()}
    contents["curves.csv"] = _table(
        ("stage", "side", "joint", "strides", "percent", "mean_deg", "sd_deg"),
        [
            (name, *place, curve.strides, *(round(float(value), 4) for value in row))
            for name, found in by_stage.items()
            for place, curve in found.items()
            for row in zip(PERCENT, curve.mean, curve.sd, strict=True)
        ],
    )
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
                "parameters": None if stage.gait is None else _parameters(stage.gait),
                "gait_variable_scores_deg": {
                    side: {
                        **msgspec.structs.asdict(scores),
                        "sagittal GPS (3 of 9 variables)": scores.sagittal_gps,
                    }
                    for side, scores in variable_scores(by_stage[name]).items()
                },
            }
            for name, stage in stages.items()
        },
    }
    contents["summary.json"] = msgspec.json.format(msgspec.json.encode(summary)) + b"\n"
    files.make_folder(folder, "--export")
    for name, content in contents.items():
        files.write(folder / name, content, "--export")
    return [folder / name for name in contents]


def _parameters(gait: Gait) -> dict[str, Any]:
    return {
        name: {
            "left": _spread(gait, "left", name),
            "right": _spread(gait, "right", name),
            "asymmetry_percent": gait.asymmetry_percent(name),
        }
        for name in PARAMETERS
    }


def _spread(gait: Gait, side: str, name: str) -> dict[str, float | None]:
    spread = getattr(gait, side)[name]
    return {**msgspec.structs.asdict(spread), "cv_percent": spread.cv_percent}


def _table(head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue().encode()
