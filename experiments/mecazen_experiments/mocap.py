"""Quality of gait capture by view: a person walks straight on, and the robot follows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

import msgspec
from rich.table import Table
from rich.text import Text

from mecazen_experiments.capture import capture
from mecazen_experiments.gait.report import export as write
from mecazen_experiments.jobs import Job, Series
from mecazen_experiments.quality import (
    MEASURED,
    STAGES,
    Curves,
    Quality,
    all_stages,
    numbers,
    quality,
    steady,
)
from mecazen_experiments.report import Do, Kind, Record, Row, regroup
from mecazen_experiments.run import file_name
from mecazen_experiments.tables import Column, table

VIEW, GAIT = "view", "case"
STANDOFF, SPEED = "follower.standoff_m", "target.path.speed_m_s"
"""The axes of such an experiment."""
SHOWN = 2.0, 1.0
"""Standoff [m] and speed [m/s] whose curves are shown, or the nearest available ones."""

ANGLES: tuple[Column, ...] = (
    *(
        (f"{joint} \\[°]\n{stage}", f"{stage}_{joint}_deg", 1)
        for joint in MEASURED
        for stage in STAGES
    ),
    *((f"{joint} \\[°]\ncentred", f"refined_{joint}_centred_deg", 1) for joint in MEASURED),
    ("jitter \\[mm]\nraw", "raw_jitter_mm", 0),
    ("refined", "refined_jitter_mm", 0),
)
GAIT_ERRORS: tuple[Column, ...] = (
    ("stride\n\\[ms]", "stride_time_err_ms", 1),
    ("stride\n\\[mm]", "stride_length_err_mm", 0),
    ("cadence\n\\[%]", "cadence_err_percent", 2),
    ("stance\n\\[%]", "stance_err_percent", 1),
    ("asymm.\n\\[%]", "asymmetry_err_percent", 1),
    *((f"{name}\nseen \\[%]", f"{name}_seen_percent", 0) for name in ("knee", "ankle", "foot")),
    ("D_err\n\\[m]", "d_err_m", 3),
    ("Θ_err\n\\[°]", "theta_err_deg", 1),
    ("odometry\n\\[%]", "odometry_drift_percent", 1),
)
PARAMETER_ERRORS: tuple[Column, ...] = (
    ("speed\n\\[%]", "speed_err_percent", 1),
    ("stance\n\\[%]", "stance_err_percent", 1),
    ("double\nsupport \\[%]", "double_support_err_percent", 1),
    ("step width\n\\[mm]", "step_width_err_mm", 0),
    ("clearance\n\\[mm]", "clearance_err_mm", 0),
    ("strike\n\\[ms]", "strike_err_ms", 0),
    ("off\n\\[ms]", "off_err_ms", 0),
    ("stride time SD\n\\[ms], true", "true_stride_time_sd_ms", 0),
    ("found", "found_stride_time_sd_ms", 0),
)
"""Signed errors for refined joints; the standard deviation is that of filtered joints."""
BY_STAGE: tuple[Column, ...] = (
    *((f"{joint}\n\\[°]", f"{joint}_deg", 1) for joint in MEASURED),
    *((f"{joint}\ncentred", f"{joint}_centred_deg", 1) for joint in MEASURED),
    ("jitter\n\\[mm]", "jitter_mm", 0),
)
LIMITS = (
    ("speed [%]", "speed_err_percent", 2.0),
    ("stance [points]", "stance_err_percent", 2.0),
    ("double support [points]", "double_support_err_percent", 2.0),
    ("step width [mm]", "step_width_err_mm", 25.0),
    ("SD of stride time [ms]", "stride_time_sd_err_ms", 10.0),
)
"""Maximum errors of parameters, for standoffs from `NEAREST_M` on."""
NEAREST_M = 1.5
GAITS: tuple[Column, ...] = tuple(
    (f"{heading}\n{stage}", f"{stage}_{name}", digits)
    for heading, name, digits in (
        ("step length\nasymm. \\[%]", "step_length_percent", 1),
        ("step time\nasymm. \\[%]", "step_time_percent", 1),
        ("stance\nasymm. \\[%]", "stance_percent", 1),
        ("left knee\n\\[°]", "left_knee_deg", 0),
        ("right knee\n\\[°]", "right_knee_deg", 0),
        ("stride\n\\[m]", "stride_m", 2),
        ("cadence\n\\[1/min]", "cadence", 0),
    )
    for stage in ("true", "found")
)


def _measure(job: Job) -> tuple[Quality, str]:
    scenario = job.load()
    found = capture(scenario)
    return quality(found, scenario.follower.standoff)[0], found.trajectory_sha256


def tables(rows: Sequence[Row[Quality]]) -> list[Table]:
    """Return the angles and the gait: by view and standoff over all speeds, and by speed.

    If there are several gaits, the last two tables show parameters that distinguish them, and the
    angles of each gait.
    """
    by_speed = sorted(rows, key=lambda row: row.labels[SPEED])

    def place(row: Row[Quality]) -> dict[str, str | float]:
        return {VIEW: row.labels[VIEW], "": f"{row.labels[STANDOFF]:g} m"}

    groups = [
        *regroup(CAPTURE, rows, place),
        *regroup(CAPTURE, by_speed, lambda row: {VIEW: "all", "": f"{row.labels[SPEED]:g} m/s"}),
    ]
    heads = [VIEW, ""]
    found = [
        _by_stage(rows),
        table(heads, ANGLES, groups, "Angles and jitter"),
        table(heads, GAIT_ERRORS, groups, "Gait"),
        table(heads, PARAMETER_ERRORS, groups, "Parameters"),
        _within_limits(rows),
    ]
    if len({row.labels[GAIT] for row in rows}) > 1:
        by_gait = sorted(rows, key=lambda row: row.labels[GAIT])
        both = regroup(CAPTURE, by_gait, lambda row: {n: row.labels[n] for n in (VIEW, GAIT)})
        found.append(table(heads, GAITS, both, "Gaits"))
        found.append(table(heads, ANGLES, both, "Angles by gait"))
    return found


def _by_stage(rows: Sequence[Row[Quality]]) -> Table:
    """Return a table of the angles in each stage over all runs."""
    (whole,) = regroup(CAPTURE, rows, lambda _: {VIEW: "all"})
    lines = []
    for stage in STAGES:
        own = [(name, mean) for name, mean in whole.means.items() if name.startswith(f"{stage}_")]
        means = {name.removeprefix(f"{stage}_"): mean for name, mean in own}
        lines.append(msgspec.structs.replace(whole, name=stage, means=means))
    return table(["stage"], BY_STAGE, lines, "Stages")


def _within_limits(rows: Sequence[Row[Quality]]) -> Table:
    """Return a table of the magnitudes of the errors of parameters, against `LIMITS`."""
    far = [row for row in rows if float(row.labels[STANDOFF]) >= NEAREST_M]
    runs = [numbers(run.record.scores) for row in far for run in row.runs]
    heads = "error", "asked", "mean magnitude", "largest", "runs within"
    found = Table(*heads, title="Limits", caption=f"from {NEAREST_M} m on; signs do not count")
    for title, name, limit in LIMITS:
        known = [abs(value) for run in runs if (value := run.get(name)) is not None]
        inside = sum(value <= limit for value in known)
        sizes = (f"{of(known):.1f}" if known else "-" for of in (fmean, max))
        found.add_row(Text(title), f"{limit:g}", *sizes, f"{inside} of {len(runs)}")
    return found


def draw(
    folder: Path, todo: Sequence[Series], rows: Sequence[Row[Quality]], do: Do
) -> Sequence[Path]:
    """Draw the curves of each view at one standoff and speed, and the errors of all."""
    from mecazen_experiments import mocap_figures  # noqa: PLC0415  # slow to import

    def distance(one: Series) -> float:
        return math.dist([float(one.labels[name]) for name in (STANDOFF, SPEED)], SHOWN)

    shown, bearings = {}, {}
    for view in dict.fromkeys(one.labels[VIEW] for one in todo):
        nearest = min((one for one in todo if one.labels[VIEW] == view), key=distance)
        place = f"{nearest.labels[STANDOFF]:g} m, {nearest.labels[SPEED]:g} m/s"
        shown[nearest.jobs[0]] = f"{view}, {place}"
        bearings[view] = nearest.jobs[0].load().follower.standoff.bearing
    found = dict(do(curves, [*shown]))
    titled = {title: found[job] for job, title in shown.items()}
    return mocap_figures.draw(folder, titled, rows, bearings)


def curves(job: Job) -> Curves:
    """Simulate a job once more; return the curves to draw."""
    scenario = job.load()
    return quality(capture(scenario), scenario.follower.standoff)[1]


def export(folder: Path, job: Job) -> Sequence[Path]:
    """Simulate a job; write its walk in all stages for gait laboratories."""
    scenario = job.load()
    walk = steady(capture(scenario))
    standoff = scenario.follower.standoff
    about = {
        "experiment": job.row,
        "seed": scenario.seed,
        "bearing_deg": math.degrees(standoff.bearing),
        "standoff_m": standoff.distance,
    }
    return write(folder / file_name(job), all_stages(walk), about)


CAPTURE = Kind("mocap", Record[Quality], _measure, numbers, tables, draw, export)
"""The kind of experiments on the quality of gait capture."""
