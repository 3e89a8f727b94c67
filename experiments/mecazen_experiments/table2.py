"""Table II of the paper, with our runs beside its figures.

"A Virtual Mecanum Wheeled Robot ROS Simulator for Multi-view and Self-Following Motion
Capture": following by the raw observation (without) and by the Kalman filter (with).
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from mecazen.errors import ConfigError

from mecazen_experiments.report import Row
from mecazen_experiments.scores import Scores
from mecazen_experiments.statistics import Interval, paired_difference

NAME = "table2"
"""The name of the experiment."""
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


def gains(rows: Iterable[Row[Scores]]) -> list[Gain]:
    """Return the gains of each variant, from the rows of all six cases.

    Raises:
        ConfigError: A case is missing, or has no errors to compare.
    """
    by_name = {row.name: row for row in rows}
    for name in (*CASES, *(f"{view} best" for view in VIEWS)):
        if name not in by_name:
            raise ConfigError(f"{NAME}: needs a case named {name!r}")
        if any(score not in by_name[name].means for score in MEASURES):
            raise ConfigError(f"{NAME}: no person walks in the case {name!r}")

    def errors(view: str, variant: str, score: str) -> dict[int, float]:
        records = [run.record for run in by_name[f"{view} {variant}"].runs]
        return {record.key.seed: getattr(record.scores.whole, score) for record in records}

    return [
        Gain(
            *(view, score, variant, over),
            paired_difference(errors(view, variant, score), errors(view, over, score)),
        )
        for view in VIEWS
        for score in MEASURES
        for variant, over in PAIRS
    ]
