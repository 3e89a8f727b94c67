"""Rows of a report: means over runs and walks, and limits."""

import pickle

import pytest
from mecazen_experiments import budget, fuzz
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.kinds import KINDS
from mecazen_experiments.report import regroup, relate, summarise, summarise_walks, within
from mecazen_experiments.statistics import Interval

from experiments import made_up


def test_a_row_is_the_mean_of_its_runs():
    row = made_up.row("short", 0.1, 0.2, 0.6)
    mean = row.means["d_err_m"]
    assert (mean.mean, mean.n) == (pytest.approx(0.3, abs=1e-12), 3)  # a few roundings
    # 4.303 (Student's distribution, n = 3) times the deviation sqrt(0.07) / sqrt(3)
    assert (mean.low, mean.high) == pytest.approx((0.3 - 0.6573, 0.3 + 0.6573), abs=1e-3)
    assert [run.record.key.seed for run in row.runs] == [1, 2, 3]


def test_runs_without_a_score_are_not_in_its_mean():
    row = made_up.row("short", 0.1, None)
    assert row.means["d_err_m"] == Interval(0.1, 0.1, 0.1, 1)
    assert "nees" not in row.means
    assert "settled_d_err_m" not in row.means


def test_a_walk_is_one_unit_however_many_seeds_it_was_run_with():
    series = made_up.series("walks", {("a", 1): 0.1, ("a", 2): 0.3, ("b", 1): 0.4})
    row = summarise(FOLLOWING, *series)
    assert row.means["d_err_m"].n == row.units == 2
    assert row.means["d_err_m"].mean == pytest.approx(0.3, abs=1e-12)  # a few roundings
    walks = summarise_walks(FOLLOWING, *series)
    assert [(walk.name, len(walk.runs)) for walk in walks] == [("walks / a", 2), ("walks / b", 1)]
    assert summarise_walks(FOLLOWING, *made_up.series("short", {(None, 1): 0.1})) == []


def test_thirty_runs_of_six_walks_have_the_interval_of_six():
    of_walk = dict(zip("abcdef", (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), strict=True))
    runs = {(walk, seed): value for walk, value in of_walk.items() for seed in range(5)}
    found = summarise(FOLLOWING, *made_up.series("walks", runs)).means["d_err_m"]
    expected = made_up.row("six", *of_walk.values()).means["d_err_m"]
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_views_of_one_case_and_seed_are_one_unit_and_cases_are_several():
    views = [made_up.row("door", 0.1, 0.2), made_up.row("door", 0.3, 0.4)]
    (both,) = regroup(FOLLOWING, views, lambda _: {"case": "all"})
    assert (len(both.runs), both.units, both.means["d_err_m"].n) == (4, 2, 2)
    cases = [made_up.row("door", 0.1, 0.2), made_up.row("crowd", 0.3, 0.4)]
    (both,) = regroup(FOLLOWING, cases, lambda _: {"case": "all"})
    assert (len(both.runs), both.units, both.means["d_err_m"].n) == (4, 4, 4)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, None),
        ({"d_err_m": 0.3}, True),
        ({"d_err_m": 0.29}, False),  # the mean, 0.2, is within it
        ({"d_err_m": 0.3, "theta_err_deg": 0.1}, False),
        ({"d_err_m": 0.3, "nees": 3.0}, False),
        ({"lost_s": 1.0}, None),
        ({"d_err_m": 0.3, "lost_s": 1.0}, None),
        ({"d_err_m": 0.2, "lost_s": 1.0}, False),
    ],
)
def test_limits_are_met_where_no_interval_reaches_above_them(limits, expected):
    found = {
        "d_err_m": Interval(0.2, 0.1, 0.3, 10),
        "theta_err_deg": Interval(2.0, 2.0, 2.0, 10),
        "lost_s": Interval(0.0, 0.0, 0.0, 9),  # too few units for a verdict
    }
    assert within(found, limits) is expected


@pytest.mark.parametrize(("max_ratio", "expected"), [(None, None), (2.5, True), (1.9, False)])
def test_a_row_is_related_to_its_reference_in_pairs(max_ratio, expected):
    errors = {(None, seed): 0.1 * seed for seed in range(1, 11)}
    clean, records = made_up.series("clean", errors)
    case = {"reference": "clean", "max_ratio": max_ratio}
    fault, more = made_up.series("fault", {run: 2.0 * of for run, of in errors.items()}, **case)
    rows = [summarise(FOLLOWING, clean, records), summarise(FOLLOWING, fault, more)]
    first, second = relate(FOLLOWING, rows, [clean, fault])
    assert (first.d_err_ratio, first.within_limits) == (None, None)
    assert second.d_err_ratio.mean == pytest.approx(2.0)
    assert second.within_limits is expected


def test_successes_have_an_exact_interval_and_partial_ones_that_of_shares():
    kind = FOLLOWING._replace(successes=["d_err_m"])
    runs = {(None, seed): 100.0 for seed in range(15)}
    found = summarise(kind, *made_up.series("all", runs)).means["d_err_m"]
    assert (found.mean, found.low, found.high) == (100.0, pytest.approx(78.2, abs=0.01), 100.0)
    # walk a succeeds in 3 of 5 runs, b in all and c in none: 160 / 3 % over three walks
    successes = {"a": [1, 1, 1, 0, 0], "b": [1] * 5, "c": [0] * 5}
    runs = {(walk, n): 100.0 * x for walk, of in successes.items() for n, x in enumerate(of)}
    found = summarise(kind, *made_up.series("walks", runs)).means["d_err_m"]
    assert (found.mean, found.n) == (pytest.approx(160.0 / 3.0), 3)
    assert found.high - found.mean == pytest.approx(4.303 * 50.33 / 3**0.5, rel=1e-3)  # Student's


@pytest.mark.parametrize("kind", [*KINDS.values(), fuzz.EPISODE, fuzz.FREEZES, budget.BOUND])
def test_every_kind_can_be_sent_to_a_worker(kind):
    assert pickle.loads(pickle.dumps(kind)).name == kind.name  # noqa: S301 - our own
