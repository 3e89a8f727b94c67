"""Table II of the paper, with our runs beside its figures.

"A Virtual Mecanum Wheeled Robot ROS Simulator for Multi-view and Self-Following Motion
Capture": following by the raw observation (without) and by the Kalman filter (with).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mecazen.errors import ConfigError
from rich.table import Table

from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import Series
from mecazen_experiments.report import Do, Row
from mecazen_experiments.run import tabulate
from mecazen_experiments.scores import Scores
from mecazen_experiments.statistics import Interval, paired_difference
from mecazen_experiments.tables import show

VIEWS = ("back", "side")
PAPER_VARIANTS = ("without", "with")
"""The variants in the paper; the third variant, best, is ours."""
CASES = tuple(f"{view} {variant}" for view in VIEWS for variant in (*PAPER_VARIANTS, "best"))
PAIRS = (("with", "without"), ("best", "with"))
"""Pairs of a variant that should be better, and the variant to compare with."""
MEASURES = {"d_err_m": ("D_err", "m", 3), "theta_err_deg": ("Θ_err", "°", 2)}
"""The paper's symbol of each score, its unit, and the digits to show."""


def gain(rows: Mapping[str, Row[Scores]], better: str, than: str, score: str) -> Interval:
    """Return the reduction of one case's error relative to another's, paired by seed."""

    def errors(case: str) -> dict[int, float]:
        records = [run.record for run in rows[case].runs]
        return {record.key.seed: getattr(record.scores.whole, score) for record in records}

    return paired_difference(errors(better), errors(than))


def tables(rows: Sequence[Row[Scores]]) -> tuple[Table, Table]:
    """Return the paper's table with ours, and the gains of each variant."""
    by_name = {row.name: row for row in rows}
    for name in CASES:
        if any(score not in by_name[name].means for score in MEASURES):
            raise ConfigError(f"kind = 'paper': no person walks in the case {name!r}")
    seeds = by_name[CASES[0]].units
    compared = Table(
        "",
        *(f"{who}\n{variant}" for variant in PAPER_VARIANTS for who in ("paper", "ours")),
        "ours\nbest",
        title="Table II",
        caption=f"ours: means over n = {seeds} seeds, each with its 95 % interval",
        show_lines=True,
    )
    gained = Table(
        "",
        *(f"{variant}\nover {over}" for variant, over in PAIRS),
        title="Gains",
        caption=f"reduction of the error, paired by n = {seeds} seeds, with its 95 % interval",
        show_lines=True,
    )
    for view in VIEWS:
        for score, (symbol, unit, digits) in MEASURES.items():
            name = f"{symbol} {view} \\[{unit}]"
            cells = []
            for variant in PAPER_VARIANTS:
                row = by_name[f"{view} {variant}"]
                published = row.published.get(score)
                cells += ["-" if published is None else f"{published:g}"]
                cells += [show(row.means[score], digits)]
            compared.add_row(name, *cells, show(by_name[f"{view} best"].means[score], digits))
            gains = [gain(by_name, f"{view} {a}", f"{view} {b}", score) for a, b in PAIRS]
            gained.add_row(name, *(show(one, digits) for one in gains))
    return compared, gained


def draw(folder: Path, todo: Sequence[Series], _: Sequence[Row[Scores]], do: Do) -> Sequence[Path]:
    """Draw the trajectories and the errors of the paper's four cases, each with its first seed."""
    from mecazen_experiments import figures  # noqa: PLC0415  # slow to import

    jobs = [one.jobs[0] for one in todo if not one.row.endswith("best")]
    return figures.draw({job.row: table for job, table in do(tabulate, jobs)}, folder)


PAPER = FOLLOWING._replace(tables=tables, draw=draw, cases=CASES)
"""The kind of experiments that compare following with the paper's results."""
