"""Table II of the paper, with our runs beside its figures.

"A Virtual Mecanum Wheeled Robot ROS Simulator for Multi-view and Self-Following Motion
Capture": following by the raw observation (without) and by the Kalman filter (with).
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from mecazen.errors import ConfigError
from rich.table import Table

from mecazen_experiments.report import Row, show
from mecazen_experiments.statistics import Interval, paired_difference

NAME = "table2"
"""Of the experiment."""
VIEWS = ("back", "side")
PAPER = ("without", "with")
"""The variants that the paper has; the third, best, is ours."""
CASES = tuple(f"{view} {variant}" for view in VIEWS for variant in PAPER)
"""Those of the paper."""
PAIRS = (("with", "without"), ("best", "with"))
"""Each variant that should gain, and over which."""
MEASURES = {"d_err_m": ("D_err", "m", 3), "theta_err_deg": ("Θ_err", "°", 2)}
"""The paper's symbol of each score, its unit, and the digits to show."""


class Gain(msgspec.Struct, frozen=True):
    """By how much one variant's error is below another's, seed by seed."""

    view: str
    score: str
    variant: str
    over: str
    difference: Interval


class Table2(msgspec.Struct, frozen=True):
    """What `mecazen experiment table2 --json` writes."""

    rows: tuple[Row, ...]
    gains: tuple[Gain, ...]


def table2(rows: Iterable[Row]) -> Table2:
    """Return the rows of all six cases with what each variant gains.

    Raises:
        ConfigError: A case is missing, or has no errors to compare.
    """
    by_name = {row.name: row for row in rows}
    for name in (*CASES, *(f"{view} best" for view in VIEWS)):
        if name not in by_name:
            raise ConfigError(f"{NAME}: needs a case named {name!r}")
        if any(by_name[name].whole[score] is None for score in MEASURES):
            raise ConfigError(f"{NAME}: nobody walks in the case {name!r}")

    def errors(view: str, variant: str, score: str) -> dict[int, float]:
        records = [run.record for run in by_name[f"{view} {variant}"].runs]
        return {record.key.seed: getattr(record.scores.whole, score) for record in records}

    gains = tuple(
        Gain(
            *(view, score, variant, over),
            paired_difference(errors(view, variant, score), errors(view, over, score)),
        )
        for view in VIEWS
        for score in MEASURES
        for variant, over in PAIRS
    )
    return Table2(tuple(by_name.values()), gains)


def tables(result: Table2) -> tuple[Table, Table]:
    """Return the paper's table, and that of the gains."""
    rows = {row.name: row for row in result.rows}
    gains = {(gain.view, gain.score, gain.variant): gain.difference for gain in result.gains}
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
                row = rows[f"{view} {variant}"]
                published = row.published.get(score)
                cells += ["-" if published is None else f"{published:g}"]
                cells += [show(row.whole[score], digits)]
            cells += [show(rows[f"{view} best"].whole[score], digits)]
            compared.add_row(name, *cells)
            gained.add_row(
                name, *(show(gains[view, score, variant], digits) for variant, _ in PAIRS)
            )
    return compared, gained
