"""Safety of following: contacts and gaps in situations with several drivers and views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from mecazen_tools.observe import watch
from rich.table import Table

from mecazen_experiments.jobs import Job
from mecazen_experiments.report import Kind, Record, Row, regroup
from mecazen_experiments.safety_scores import Safety, safety
from mecazen_experiments.statistics import most_per_hour
from mecazen_experiments.tables_old import Column, table

CAPTION = (
    "contacts: sums over the runs, those that the robot caused and all; at most: upper limit of "
    "the rate of those that it caused, with 95 % confidence; gaps: the smallest; others: means, "
    "each with its 95 % interval over the pairs of situation and seed"
)
COLUMNS: tuple[Column, ...] = (
    ("contacts\nperson", "contacts_person", 0),
    ("person\nall", "contacts_person_all", 0),
    ("others", "contacts_others", 0),
    ("others\nall", "contacts_others_all", 0),
    ("walls", "contacts_world", 0),
    ("gap \\[m]\nperson", "gap_person_m", 2),
    ("others", "gap_others_m", 2),
    ("walls", "gap_world_m", 2),
    ("conflict\n\\[s]", "conflict_s", 2),
    ("in view\n\\[%]", "view_percent", 1),
    ("regain\n\\[s]", "regain_s", 2),
    ("D_err\n\\[m]", "d_err_m", 3),
    ("Θ_err\n\\[°]", "theta_err_deg", 1),
    ("frozen\n\\[s]", "frozen_s", 2),
    ("jerk\n\\[m/s³]", "jerk_rms_m_s3", 1),
)


def _at_most(row: Row[Safety]) -> str:
    caused = ("contacts_person", "contacts_others", "contacts_world")
    most = most_per_hour(sum(row.sums[name] for name in caused), row.sums["time_s"] / 3600.0)
    return f"{most:.1f}"


MORE: Mapping[str, Callable[[Row[Any]], str]] = {"caused,\nat most\n\\[1/h]": _at_most}
"""Columns that are computed from several scores."""


def _measure(job: Job) -> tuple[Safety, str]:
    scenario = job.load()
    seen = watch(scenario)
    return safety(seen, scenario), seen.trajectory_sha256


def tables(rows: Sequence[Row[Safety]]) -> list[Table]:
    """Return a row for each situation and driver, and for each driver over all situations."""

    def names(row: Row[Safety]) -> Mapping[str, str | float]:
        return {axis: row.labels[axis] for axis in ("case", "driver")}

    views = list(dict.fromkeys(row.labels["view"] for row in rows))
    by_view = sorted(rows, key=lambda row: views.index(row.labels["view"]))
    groups = [
        *regroup(SAFETY, rows, names),
        *regroup(SAFETY, by_view, lambda row: {**names(row), "case": "all"}),
    ]
    return [table(["situation", "driver"], COLUMNS, groups, caption=CAPTION, more=MORE)]


SUMS = [name for name in Safety.__struct_fields__ if name.startswith("contacts_")] + ["time_s"]
SAFETY = Kind(
    "safety",
    Record[Safety],
    _measure,
    msgspec.structs.asdict,
    tables,
    sums=SUMS,
    least=[name for name in Safety.__struct_fields__ if name.startswith("gap_")],
)
"""The kind of experiments on the safety of following."""
