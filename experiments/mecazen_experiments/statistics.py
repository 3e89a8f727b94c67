"""Confidence intervals of means, of shares of successes, and of statistics of several units."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import fmean, stdev
from typing import TypeVar

import msgspec
import numpy as np
from scipy.stats import binomtest, chi2, t

T = TypeVar("T")
LEAST_UNITS = 10
"""Minimum number of independent values for a verdict on a limit."""


class Interval(msgspec.Struct, frozen=True):
    """A mean and its 95 % confidence interval."""

    mean: float
    low: float
    high: float
    n: int
    """The number of independent values."""

    @property
    def values(self) -> tuple[float, float]:
        """The two values of a `mean_interval` with n = 2."""
        half = (self.high - self.mean) / _quantile(2)
        return self.mean - half, self.mean + half

    @property
    def ends(self) -> tuple[float, float]:
        """The limits, or with n = 2 the two values."""
        return self.values if self.n == 2 else (self.low, self.high)


def mean_interval(values: Sequence[float]) -> Interval:
    """Return the mean of `values` with its t interval (Student 1908); one value has no width."""
    if not values:
        raise ValueError("there are no values to take the mean of")
    mean, n = fmean(values), len(values)
    if min(values) == max(values):
        return Interval(mean, mean, mean, n)
    half = _quantile(n) * stdev(values) / math.sqrt(n)
    return Interval(mean, mean - half, mean + half, n)


def jackknife(
    statistics: Callable[[Sequence[T]], Sequence[float]], units: Sequence[T]
) -> list[Interval]:
    """Return statistics of all units together, each with its t interval over the units.

    The values of the interval are Tukey's pseudo-values (Annals of Mathematical Statistics 29,
    1958), which are the influence of each unit on a statistic; they are shifted so that their mean
    is the statistic. With a single unit, an interval has no width. A statistic that is NaN without
    one of the units has NaN as limits.
    """
    whole, n = np.asarray(statistics(units)), len(units)
    if n == 1:
        return [mean_interval([value]) for value in whole.tolist()]
    without = np.array([statistics([*units[:i], *units[i + 1 :]]) for i in range(n)])
    pseudo = whole + (n - 1) * (without.mean(axis=0) - without)
    return [
        Interval(value, math.nan, math.nan, n) if np.isnan(values).any() else mean_interval(values)
        for value, values in zip(whole.tolist(), pseudo.T.tolist(), strict=True)
    ]


def _quantile(n: int) -> float:
    """Return the 97.5 % quantile of Student's distribution for n values."""
    return float(t.ppf(0.975, n - 1))


def share_interval(successes: Sequence[bool]) -> Interval:
    """Return the share of successes [%] with its exact interval (Clopper and Pearson 1934)."""
    test = binomtest(sum(map(bool, successes)), len(successes))
    limits = test.proportion_ci(0.95, method="exact")
    mean, low, high = (100.0 * float(share) for share in (test.statistic, *limits))
    return Interval(mean, low, high, test.n)


def most_per_hour(events: float, hours: float) -> float:
    """Return the upper limit of the rate of rare events, with 95 % confidence [1/h].

    The limit is that of Garwood for the Poisson distribution (Biometrika 28, 1936): 3.0 / hours
    without events.
    """
    return float(chi2.ppf(0.95, 2.0 * (events + 1.0))) / 2.0 / hours
