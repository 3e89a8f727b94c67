"""Scores of following: distance, angle, smoothness, estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
from mecazen_tools.observe import observe
from rich.table import Table

from mecazen_experiments.jobs import Job
from mecazen_experiments.report import RATIO, Kind, Record, Row, meets
from mecazen_experiments.scores import Scores, score
from mecazen_experiments.statistics import LEAST_UNITS
from mecazen_experiments.tables_old import CAPTION, Column, show, table

COLUMNS: tuple[Column, ...] = (
    *(
        (f"{part}\n{heading}", f"{prefix}{name}", digits)
        for part, prefix in (("whole", ""), ("settled", "settled_"))
        for heading, name, digits in (
            ("D_err \\[m]", "d_err_m", 4),
            ("Θ_err \\[°]", "theta_err_deg", 2),
        )
    ),
    ("estimate\nyaw \\[°]", "estimate_yaw_err_deg", 2),
    ("NEES", "nees", 2),
    ("lost \\[s]", "lost_s", 2),
)


def _measure(job: Job) -> tuple[Scores, str]:
    scenario = job.load()
    seen = observe(scenario)
    return score(seen.table, scenario.follower.standoff), seen.trajectory_sha256


def _numbers(scores: Scores) -> Mapping[str, float | None]:
    settled = msgspec.structs.asdict(scores.settled)
    return msgspec.structs.asdict(scores.whole) | {f"settled_{n}": v for n, v in settled.items()}


def _ratio(row: Row[Scores]) -> str:
    return "" if row.d_err_ratio is None else show(row.d_err_ratio, 2)


def _limits(row: Row[Scores]) -> str:
    found = {**row.means, **({RATIO: row.d_err_ratio} if row.d_err_ratio else {})}
    marks = {None: "", True: "[green]✓[/] ", False: "[red]✗[/] "}
    return ", ".join(
        f"{marks[meets(found.get(name), limit)]}{name} ≤ {limit:g}"
        for name, limit in row.limits.items()
    )


def cases(rows: Sequence[Row[Scores]]) -> list[Table]:
    """Return the table of the cases, with their references and limits."""
    caption = (
        f"{CAPTION}; ✓ where all of the interval of {LEAST_UNITS} or more units is within a limit "
        "of the experiment's file"
    )
    more = {"of the\nreference": _ratio, "limits": _limits}
    return [table(["case"], COLUMNS, rows, caption=caption, more=more)]


FOLLOWING = Kind("following", Record[Scores], _measure, _numbers, cases)
