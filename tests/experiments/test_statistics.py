"""Intervals of means, by hand and by how often they hold the truth."""

import math

import numpy as np
import pytest
from mecazen_experiments.identify.models import jackknife
from mecazen_experiments.tables import most_per_hour, share_interval
from mecazen_tools.statistics import Interval, mean_interval, paired_difference


def test_an_interval_of_equal_values_has_no_width_and_of_none_is_an_error():
    assert mean_interval([0.1] * 30) == Interval(mean=0.1, low=0.1, high=0.1, n=30)
    with pytest.raises(ValueError, match="no values"):
        mean_interval([])


def test_an_interval_is_that_of_student():
    # n = 2: tan(0.475 pi) = 12.706 times the half distance of the values, 0.5
    interval = mean_interval([1.0, 2.0])
    assert (interval.low, interval.high) == pytest.approx((1.5 - 6.353, 1.5 + 6.353), abs=1e-3)
    assert interval.values == pytest.approx((1.0, 2.0), abs=1e-12)  # a few roundings
    # n = 5: 2.776 (table of Student's distribution) times the deviation sqrt(2.5) / sqrt(5)
    interval = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776 * math.sqrt(2.5 / 5.0)
    assert (interval.low, interval.high) == pytest.approx((3.0 - half, 3.0 + half), abs=1e-3)


@pytest.mark.parametrize("n", [2, 3, 30])
def test_95_of_100_intervals_hold_the_true_mean(n):
    draws = np.random.default_rng(n).normal(2.0, 1.0, (6000, n)).tolist()
    held = [interval.low <= 2.0 <= interval.high for interval in map(mean_interval, draws)]
    # 0.01 is 3.6 deviations sqrt(0.95 * 0.05 / 6000)
    assert np.mean(held) == pytest.approx(0.95, abs=0.01)


def test_a_jackknife_of_means_is_their_interval():
    values = [1.0, 2.0, 3.0, 4.0, 5.0]
    (interval,) = jackknife(lambda kept: [math.fsum(kept) / len(kept)], values)
    direct = mean_interval(values)
    assert (interval.low, interval.high) == pytest.approx((direct.low, direct.high))
    assert jackknife(lambda kept: [kept[0]], [2.0]) == [Interval(2.0, 2.0, 2.0, 1)]
    (interval,) = jackknife(lambda kept: [math.nan if 1.0 not in kept else 7.0], values)
    assert (interval.mean, math.isnan(interval.low), math.isnan(interval.high)) == (7.0, True, True)


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        (15, 15, 100.0 * 0.025 ** (1.0 / 15.0), 100.0),  # all: the limit solves p^15 = 0.025
        (0, 15, 0.0, 100.0 - 100.0 * 0.025 ** (1.0 / 15.0)),
        (1, 10, 0.2529, 44.5016),  # Clopper and Pearson's table has 0.3 to 44.5
    ],
)
def test_a_share_of_successes_has_its_exact_interval(successes, n, low, high):
    interval = share_interval([True] * successes + [False] * (n - successes))
    assert (interval.mean, interval.n) == (pytest.approx(100.0 * successes / n), n)
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=1e-3)


@pytest.mark.parametrize(("events", "most"), [(0, 2.996), (1, 4.744), (3, 7.754)])
def test_the_limit_of_a_rate_is_that_of_the_published_table(events, most):
    # one-sided 95 % limits of Poisson's distribution, Garwood 1936
    assert most_per_hour(events, 1.0) == pytest.approx(most, abs=5e-4)
    assert most_per_hour(events, 4.0) == pytest.approx(most / 4.0, abs=5e-4)


def test_a_difference_is_taken_seed_by_seed_where_both_have_it():
    before = {1: 1.0, 2: 5.0, 3: 100.0}
    after = {2: 5.5, 1: 1.5, 4: -100.0}
    assert paired_difference(before, after) == Interval(mean=0.5, low=0.5, high=0.5, n=2)
