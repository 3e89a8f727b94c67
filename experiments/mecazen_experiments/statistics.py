"""Confidence intervals of shares of successes, of rates and of statistics over sessions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from mecazen_tools.statistics import Interval, mean_interval
from scipy.stats import binomtest, chi2

T = TypeVar("T")


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
