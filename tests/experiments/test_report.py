"""Rows of a report: means over runs and walks, and limits."""

import pickle

import pytest
from mecazen_experiments import budget, fuzz
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.kinds import KINDS
from mecazen_experiments.report import relate, summarise, summarise_walks, within
from mecazen_experiments.statistics import Interval

from experiments import made_up


def test_a_row_is_the_mean_of_its_runs():
    row = made_up.row("short", 0.1, 0.2, 0.6)
    mean = row.means["d_err_m"]
    assert (mean.mean, mean.n) == (pytest.approx(0.3, abs=1e-12), 3)  # a few roundings
    assert 0.1 <= mean.low < mean.mean < mean.high <= 0.6
    assert [run.record.key.seed for run in row.runs] == [1, 2, 3]


def test_runs_without_a_score_are_not_in_its_mean():
    row = made_up.row("short", 0.1, None)
    assert row.means["d_err_m"] == Interval(0.1, 0.1, 0.1, 1)
    assert "nees" not in row.means
    assert "settled_d_err_m" not in row.means


def test_seeds_of_a_walk_are_not_independent_so_each_walk_counts_by_its_mean():
    series = made_up.series("walks", {("a", 1): 0.1, ("a", 2): 0.2, ("b", 1): 0.45})
    mean = summarise(FOLLOWING, *series).means["d_err_m"]
    assert mean.mean == pytest.approx(0.3, abs=1e-12)  # a few roundings
    assert mean.n == 2
    assert (mean.low, mean.high) == pytest.approx((0.15, 0.45))
    walks = summarise_walks(FOLLOWING, *series)
    assert [(walk.name, len(walk.runs)) for walk in walks] == [("walks / a", 2), ("walks / b", 1)]
    assert summarise_walks(FOLLOWING, *made_up.series("short", {(None, 1): 0.1})) == []


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, None),
        ({"d_err_m": 0.3}, True),
        ({"d_err_m": 0.29}, False),
        ({"d_err_m": 0.3, "theta_err_deg": 0.1}, False),
        ({"d_err_m": 0.3, "nees": 3.0}, False),
    ],
)
def test_limits_hold_where_no_interval_reaches_above_them_and_no_score_is_missing(limits, expected):
    found = {
        "d_err_m": Interval(0.2, 0.1, 0.3, 5),
        "theta_err_deg": Interval(2.0, 2.0, 2.0, 5),
    }
    assert within(found, limits) is expected


@pytest.mark.parametrize(("max_ratio", "expected"), [(None, None), (2.5, True), (1.5, False)])
def test_a_row_is_related_to_its_reference(max_ratio, expected):
    clean, records = made_up.series("clean", {(None, 1): 0.1})
    case = {"reference": "clean", "max_ratio": max_ratio}
    fault, more = made_up.series("fault", {(None, 1): 0.2}, **case)
    rows = [summarise(FOLLOWING, clean, records), summarise(FOLLOWING, fault, more)]
    first, second = relate(rows, [clean, fault])
    assert (first.d_err_ratio, first.within_limits) == (None, None)
    assert second.d_err_ratio == pytest.approx(2.0)
    assert second.within_limits is expected


@pytest.mark.parametrize("kind", [*KINDS.values(), fuzz.EPISODE, fuzz.FREEZES, budget.BOUND])
def test_every_kind_can_be_sent_to_a_worker(kind):
    assert pickle.loads(pickle.dumps(kind)).name == kind.name  # noqa: S301 - our own
