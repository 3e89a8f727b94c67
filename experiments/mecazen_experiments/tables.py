"""Tables of experiments for the terminal: each mean above its 95 % interval."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.table import Column as Head
from rich.table import Table
from rich.text import Text

from mecazen_experiments.mocap import CAPTURE
from mecazen_experiments.quality import MEASURED, Quality
from mecazen_experiments.report import Row, regroup
from mecazen_experiments.safety_scores import Safety
from mecazen_experiments.statistics import Interval
from mecazen_experiments.table2 import MEASURES, PAIRS, PAPER, VIEWS, Gain
from mecazen_experiments.tune import Best

CAPTION = "means over the runs, below each its 95 % interval"

Column = tuple[str, str, int]
"""Heading, name of a score, and digits to show."""
CASE_COLUMNS: tuple[Column, ...] = (
    *(
        (f"{part}\n{heading}", f"{prefix}{score}", digits)
        for part, prefix in (("whole", ""), ("settled", "settled_"))
        for heading, score, digits in (
            ("D_err \\[m]", "d_err_m", 4),
            ("Θ_err \\[°]", "theta_err_deg", 2),
        )
    ),
    ("estimate\nyaw \\[°]", "estimate_yaw_err_deg", 2),
    ("NEES", "nees", 2),
    ("lost \\[s]", "lost_s", 2),
)
BUDGET_COLUMNS: tuple[Column, ...] = (
    ("D_err \\[m]", "d_err_m", 4),
    ("by\ncontrol", "control_d_err_m", 4),
    ("Θ_err \\[°]", "theta_err_deg", 2),
    ("by\ncontrol", "control_theta_err_deg", 2),
    ("estimate\nposition \\[m]", "filter_position_m", 4),
    ("least by\nsmoothing", "smoother_position_m", 4),
    ("estimate\nyaw \\[°]", "filter_yaw_deg", 2),
    ("least by\nsmoothing", "smoother_yaw_deg", 2),
)
ANGLE_COLUMNS: tuple[Column, ...] = (
    *(
        (f"{joint} \\[°]\n{stage}", f"{stage}_{joint}_deg", 1)
        for joint in MEASURED
        for stage in ("raw", "refined")
    ),
    *((f"{joint} \\[°]\ncentred", f"refined_{joint}_centred_deg", 1) for joint in MEASURED),
    ("jitter \\[mm]\nraw", "raw_jitter_mm", 0),
    ("refined", "refined_jitter_mm", 0),
)
GAIT_COLUMNS: tuple[Column, ...] = (
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
GAITS_COLUMNS: tuple[Column, ...] = tuple(
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
SAFETY_CAPTION = (
    "contacts: sums over the runs, those that the robot caused and all; gaps: the smallest; "
    "others: means, below each its 95 % interval"
)
SUMS = (
    ("contacts\nperson", "contacts_person"),
    ("person\nall", "contacts_person_all"),
    ("others", "contacts_others"),
    ("others\nall", "contacts_others_all"),
    ("walls", "contacts_world"),
)
LEAST = (
    ("gap \\[m]\nperson", "gap_person_m"),
    ("others", "gap_others_m"),
    ("walls", "gap_world_m"),
)
SAFETY_COLUMNS: tuple[Column, ...] = (
    ("conflict\n\\[s]", "conflict_s", 2),
    ("in view\n\\[%]", "view_percent", 1),
    ("regain\n\\[s]", "regain_s", 2),
    ("D_err\n\\[m]", "d_err_m", 3),
    ("Θ_err\n\\[°]", "theta_err_deg", 1),
    ("frozen\n\\[s]", "frozen_s", 2),
    ("jerk\n\\[m/s³]", "jerk_rms_m_s3", 1),
)
"""Headings and names of scores; the last with digits to show."""


def show(interval: Interval | None, digits: int) -> str:
    """Return a mean and, in a line of its own, its interval if it has several values."""
    if interval is None:
        return "-"
    if interval.n == 1:
        return f"{interval.mean:.{digits}f}"
    return "{0:.{3}f}\n[dim]{1:.{3}f} … {2:.{3}f}[/]".format(
        interval.mean, interval.low, interval.high, digits
    )


def _cells(means: Mapping[str, Interval], columns: Sequence[Column]) -> list[str]:
    return [show(means.get(name), digits) for _, name, digits in columns]


def cases(rows: Sequence[Row[Any]]) -> Table:
    """Return the table of an experiment's cases."""
    shown = Table(Head("case", overflow="fold"), "runs", show_lines=True, caption=CAPTION)
    for heading in (*(one[0] for one in CASE_COLUMNS), "of the\nreference", "limits"):
        shown.add_column(heading)
    for row in rows:
        shown.add_row(
            Text(row.name),  # not markup, whatever it is
            str(len(row.runs)),
            *_cells(row.means, CASE_COLUMNS),
            "" if row.d_err_ratio is None else f"{row.d_err_ratio:.2f}",
            {None: "", True: "[green]✓[/]", False: "[red]✗[/]"}[row.within_limits],
        )
    return shown


def budget(rows: Sequence[Row[Any]]) -> Table:
    """Return the table of an error budget."""
    titles = (heading for heading, *_ in BUDGET_COLUMNS)
    shown = Table("case", *titles, caption=CAPTION, show_lines=True)
    for row in rows:
        shown.add_row(row.name, *_cells(row.means, BUDGET_COLUMNS))
    return shown


def best(found: Best) -> Table:
    """Return the settings that a search has found."""
    costs = f"cost {found.training_cost:.4g} in training, {found.held_out_cost:.4g} held out"
    failed = f"{found.failed_trials} of {found.trials} trials failed"
    shown = Table("case", "setting", "value", caption=f"{found.objective}: {costs}; {failed}")
    for case, settings in found.settings.items():
        for key, value in settings.items():
            shown.add_row(case, key, f"{value:g}")
    return shown


def table2(rows: Sequence[Row[Any]], gains: Iterable[Gain]) -> tuple[Table, Table]:
    """Return the paper's table, and that of the gains."""
    by_name = {row.name: row for row in rows}
    differences = {(gain.view, gain.score, gain.variant): gain.difference for gain in gains}
    compared = Table(
        "",
        *(f"{who}\n{variant}" for variant in PAPER for who in ("paper", "ours")),
        "ours\nbest",
        title="Table II",
        caption="ours: means over the seeds, below each its 95 % interval",
        show_lines=True,
    )
    gained = Table(
        "",
        *(f"{variant}\nover {over}" for variant, over in PAIRS),
        title="Gains",
        caption="reduction of the error, paired by seed, with its 95 % interval",
        show_lines=True,
    )
    for view in VIEWS:
        for score, (symbol, unit, digits) in MEASURES.items():
            name = f"{symbol} {view} \\[{unit}]"
            cells = []
            for variant in PAPER:
                row = by_name[f"{view} {variant}"]
                published = row.published.get(score)
                cells += ["-" if published is None else f"{published:g}"]
                cells += [show(row.means[score], digits)]
            cells += [show(by_name[f"{view} best"].means[score], digits)]
            compared.add_row(name, *cells)
            gained.add_row(
                name, *(show(differences[view, score, variant], digits) for variant, _ in PAIRS)
            )
    return compared, gained


def mocap(rows: Sequence[Row[Quality]]) -> list[Table]:
    """Return the angles and the gait: by view and standoff over all speeds, and by speed.

    If there are several gaits, the last table has what tells them from each other.
    """
    by_speed = sorted(rows, key=lambda row: row.labels["speed_m_s"])
    groups = [
        *regroup(
            CAPTURE,
            rows,
            lambda row: {"view": row.labels["view"], "": f"{row.labels['standoff_m']:g} m"},
        ),
        *regroup(
            CAPTURE,
            by_speed,
            lambda row: {"view": "all", "": f"{row.labels['speed_m_s']:g} m/s"},
        ),
    ]
    found = [
        _places("Angles and jitter", ANGLE_COLUMNS, groups),
        _places("Gait", GAIT_COLUMNS, groups),
    ]
    if len({row.labels["gait"] for row in rows}) > 1:
        by_gait = regroup(
            CAPTURE,
            sorted(rows, key=lambda row: row.labels["gait"]),
            lambda row: {name: row.labels[name] for name in ("view", "gait")},
        )
        found.append(_places("Gaits", GAITS_COLUMNS, by_gait))
    return found


def _places(title: str, columns: Sequence[Column], rows: Sequence[Row[Quality]]) -> Table:
    titles = (heading for heading, *_ in columns)
    shown = Table("view", "", "runs", *titles, show_lines=True, title=title, caption=CAPTION)
    for row in rows:
        labels = map(str, row.labels.values())
        shown.add_row(*labels, str(len(row.runs)), *_cells(row.means, columns))
    return shown


def safety(rows: Sequence[Row[Safety]]) -> Table:
    """Return the table of an experiment of safety."""
    names = (Head(name, no_wrap=True) for name in ("situation", "driver", "runs"))
    shown = Table(*names, show_lines=True, caption=SAFETY_CAPTION)
    for columns in (SUMS, LEAST, SAFETY_COLUMNS):
        for heading, *_ in columns:
            shown.add_column(str(heading))
    for row in rows:
        least = [row.least[name] for _, name in LEAST]
        shown.add_row(
            *map(str, row.labels.values()),
            str(len(row.runs)),
            *(f"{row.sums[name]:g}" for _, name in SUMS),
            *("" if value is None else f"{value:.2f}" for value in least),
            *_cells(row.means, SAFETY_COLUMNS),
        )
    return shown
