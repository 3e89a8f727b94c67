"""Bootstrap intervals of means, and of differences paired by seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import TypeVar

import msgspec
import numpy as np
from scipy.stats import bootstrap, chi2

SEED = 1
"""Seed of the resampling: the same values give the same interval."""
Key = TypeVar("Key", int, str)
"""The key of a pair of runs: a seed, or the name of an episode."""


class Interval(msgspec.Struct, frozen=True):
    """A mean and its 95 % confidence interval."""

    mean: float
    low: float
    high: float
    n: int
    """The number of independent values."""


def mean_interval(values: Sequence[float]) -> Interval:
    """Return the mean of `values` with its bootstrap interval; a single value has no width.

    Bias-corrected and accelerated (BCa), Efron (1987), Better Bootstrap Confidence Intervals:
    the distribution need not be normal or symmetric.
    """
    if not values:
        raise ValueError("there are no values to take the mean of")
    mean, n = fmean(values), len(values)
    if min(values) == max(values):
        return Interval(mean, mean, mean, n)
    interval = bootstrap(
        (np.asarray(values),), np.mean, rng=np.random.default_rng(SEED)
    ).confidence_interval
    return Interval(mean, float(interval.low), float(interval.high), n)


def most_per_hour(events: float, hours: float) -> float:
    """Return the upper limit of the rate of rare events, with 95 % confidence [1/h].

    The limit is that of Garwood for the Poisson distribution (Biometrika 28, 1936): 3.0 / hours
    without events.
    """
    return float(chi2.ppf(0.95, 2.0 * (events + 1.0))) / 2.0 / hours


def paired_ratio(a: Mapping[Key, float], b: Mapping[Key, float]) -> Interval | None:
    """Return the mean of b over that of a, for the keys that both have; None without such keys.

    Both are resampled together, so common effects of a key cancel.
    """
    keys = sorted(a.keys() & b.keys())
    if not keys:
        return None
    below, above = ([of[key] for key in keys] for of in (a, b))
    ratio, n = fmean(above) / fmean(below), len(keys)
    if len({b[key] / a[key] for key in keys}) == 1:
        return Interval(ratio, ratio, ratio, n)
    interval = bootstrap(
        (np.asarray(above), np.asarray(below)),
        lambda x, y, axis: np.mean(x, axis=axis) / np.mean(y, axis=axis),
        paired=True,
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Interval(ratio, float(interval.low), float(interval.high), n)


def paired_difference(a: Mapping[Key, float], b: Mapping[Key, float]) -> Interval:
    """Return the mean of b - a, over the seeds or episodes that both have.

    Common effects of a seed, such as its noise, cancel in the difference.
    """
    return mean_interval([b[key] - a[key] for key in sorted(a.keys() & b.keys())])
