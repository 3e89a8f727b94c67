"""Rows of a report: means over runs and walks, and limits."""

from __future__ import annotations

import io

import pytest
from mecazen_experiments.report import Row, summarise, summarise_walks, table, within
from mecazen_experiments.statistics import Interval
from rich.console import Console


def shown(rows: list[Row]) -> str:
    console = Console(file=io.StringIO(), width=160)
    console.print(table(rows))
    return console.file.getvalue()


def test_a_row_is_the_mean_of_its_runs(make_series):
    row = summarise(*make_series("short", {(None, 1): 0.1, (None, 2): 0.2, (None, 3): 0.6}))
    mean = row.whole["d_err_m"]
    assert (mean.mean, mean.n) == (pytest.approx(0.3, abs=1e-12), 3)  # a few roundings
    assert 0.1 <= mean.low < mean.mean < mean.high <= 0.6
    assert [run.record.key.seed for run in row.runs] == [1, 2, 3]


def test_runs_without_a_score_are_not_in_its_mean(make_series):
    row = summarise(*make_series("short", {(None, 1): 0.1, (None, 2): None}))
    assert row.whole["d_err_m"] == Interval(0.1, 0.1, 0.1, 1)
    assert row.whole["nees"] is None
    assert row.settled["d_err_m"] is None


def test_a_row_counts_the_runs_of_all_walks_the_same(make_series):
    series = make_series("walks", {("a", 1): 0.1, ("a", 2): 0.1, ("b", 1): 0.4})
    mean = summarise(*series).whole["d_err_m"]
    assert mean.mean == pytest.approx(0.2, abs=1e-12)  # a few roundings
    walks = summarise_walks(*series)
    assert [(walk.name, len(walk.runs)) for walk in walks] == [("walks / a", 2), ("walks / b", 1)]
    assert summarise_walks(*make_series("short", {(None, 1): 0.1})) == []


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, None),
        ({"d_err_m": 0.2}, True),
        ({"d_err_m": 0.19}, False),
        ({"d_err_m": 0.3, "theta_err_deg": 0.1}, False),
        ({"d_err_m": 0.3, "nees": 3.0}, False),
    ],
)
def test_limits_hold_where_no_mean_is_above_them_or_missing(limits, expected):
    found = {
        "d_err_m": Interval(0.2, 0.1, 0.3, 5),
        "theta_err_deg": Interval(2.0, 2.0, 2.0, 5),
        "nees": None,
    }
    assert within(found, limits) is expected


def test_the_table_has_means_intervals_and_marks(make_series):
    runs = {(None, 1): 0.1, (None, 2): 0.1}
    good = summarise(*make_series("good [red]", runs, limits={"d_err_m": 0.2}))
    bad = summarise(*make_series("bad", runs, limits={"d_err_m": 0.05}))
    text = shown([good, bad])
    for word in ("good [red]", "0.1000", "0.1000 … 0.1000", "1.00", "D_err [m]", "✓", "✗"):
        assert word in text
