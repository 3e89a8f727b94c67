"""Intervals of means, by hand and by how often they hold the truth."""

import numpy as np
import pytest
from mecazen_experiments.statistics import (
    Interval,
    mean_interval,
    most_per_hour,
    paired_difference,
    paired_ratio,
)


def normal(seed, n=30, mean=2.0, deviation=1.0):
    return np.random.default_rng(seed).normal(mean, deviation, n).tolist()


@pytest.mark.parametrize("n", [1, 30])
def test_equal_values_have_no_width(n):
    assert mean_interval([0.1] * n) == Interval(mean=0.1, low=0.1, high=0.1, n=n)


def test_no_value_and_no_common_seed_are_errors():
    with pytest.raises(ValueError, match="no values"):
        mean_interval([])
    with pytest.raises(ValueError, match="no values"):
        paired_difference({1: 1.0}, {2: 1.0})


def test_of_two_values_the_interval_is_between_them():
    # resamples of two have three means; more than 2.5 % of them are at each end
    assert mean_interval([1.0, 2.0]) == Interval(mean=1.5, low=1.0, high=2.0, n=2)


def test_95_of_100_intervals_hold_the_true_mean():
    runs = 400
    intervals = [mean_interval(normal(seed)) for seed in range(runs)]
    held = sum(interval.low <= 2.0 <= interval.high for interval in intervals)
    # The bootstrap takes the deviation with 1/n and normal percentiles: of 30 values that is
    # P(|t29| < 1.96 sqrt(29/30)) = 0.936; ± 4 deviations sqrt(0.936 * 0.064 / 400) = 0.012.
    assert held / runs == pytest.approx(0.936, abs=4 * 0.012)
    assert intervals[1] == mean_interval(normal(1))  # the resampling has a seed


def test_the_interval_of_skewed_values_is_skewed():
    interval = mean_interval(np.random.default_rng(1).exponential(1.0, 30).tolist())
    assert interval.high - interval.mean > 1.1 * (interval.mean - interval.low)


@pytest.mark.parametrize(("events", "most"), [(0, 2.996), (1, 4.744), (3, 7.754)])
def test_the_limit_of_a_rate_is_that_of_the_published_table(events, most):
    # one-sided 95 % limits of Poisson's distribution, Garwood 1936
    assert most_per_hour(events, 1.0) == pytest.approx(most, abs=5e-4)
    assert most_per_hour(events, 4.0) == pytest.approx(most / 4.0, abs=5e-4)


def test_a_difference_is_taken_seed_by_seed_where_both_have_it_in_any_order():
    before = {1: 1.0, 2: 5.0, 3: 100.0}
    after = {2: 5.5, 1: 1.5, 4: -100.0}
    assert paired_difference(before, after) == Interval(mean=0.5, low=0.5, high=0.5, n=2)
    before, after = dict(enumerate(normal(1))), dict(enumerate(normal(2)))
    backwards = dict(reversed(after.items()))
    assert paired_difference(before, after) == paired_difference(before, backwards)


def test_pairing_narrows_the_interval_of_what_a_seed_does_to_both():
    common = np.array(normal(1))
    before = common + normal(2, mean=0.0, deviation=0.1)
    after = common + normal(3, mean=0.5, deviation=0.1)
    paired = paired_difference(dict(enumerate(before)), dict(enumerate(after)))
    shuffled = np.random.default_rng(4).permutation(after)
    unpaired = paired_difference(dict(enumerate(before)), dict(enumerate(shuffled)))
    assert paired.low < 0.5 < paired.high
    # their deviations are 0.1 sqrt(2) and sqrt(2): a tenth, and twice that for so few values
    assert paired.high - paired.low < 0.2 * (unpaired.high - unpaired.low)


def test_a_ratio_is_that_of_the_means_of_pairs():
    assert paired_ratio({1: 2.0, 2: 4.0}, {1: 3.0, 2: 6.0, 3: 9.0}) == Interval(1.5, 1.5, 1.5, 2)
    assert paired_ratio({1: 2.0}, {1: 3.0}) == Interval(1.5, 1.5, 1.5, 1)
    assert paired_ratio({1: 2.0}, {2: 3.0}) is None


def test_the_interval_of_a_ratio_holds_it_and_is_narrow_where_pairs_are_alike():
    common = np.array(normal(1, mean=5.0))
    before, after = (
        dict(enumerate(common)),
        dict(enumerate(2.0 * common + normal(2, deviation=0.1))),
    )
    ratio = paired_ratio(before, after)
    # (2 * 5 + 2) / 5 but for the sample's own mean
    assert ratio.low < ratio.mean < ratio.high
    assert ratio.mean == pytest.approx(2.4, rel=0.1)
    # the shift of 2 over the varying mean: 2 / 5 * 1 / 5 / sqrt(30) by 4 deviations
    assert ratio.high - ratio.low < 0.06
