"""Confidence intervals of means, and of differences paired by seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import fmean, stdev
from typing import TypeVar

import msgspec
from scipy.stats import t

Key = TypeVar("Key", int, str)
"""The key of a pair of runs: a seed, or the name of an episode."""
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
    def ends(self) -> tuple[float, float]:
        """The limits, or with n = 2 the two values of a `mean_interval`."""
        if self.n != 2:
            return self.low, self.high
        half = (self.high - self.mean) / _quantile(2)
        return self.mean - half, self.mean + half


def mean_interval(values: Sequence[float]) -> Interval:
    """Return the mean of `values` with its t interval (Student 1908); one value has no width."""
    if not values:
        raise ValueError("there are no values to take the mean of")
    mean, n = fmean(values), len(values)
    if min(values) == max(values):
        return Interval(mean, mean, mean, n)
    half = _quantile(n) * stdev(values) / math.sqrt(n)
    return Interval(mean, mean - half, mean + half, n)


def _quantile(n: int) -> float:
    """Return the 97.5 % quantile of Student's distribution for n values."""
    return float(t.ppf(0.975, n - 1))


def paired_difference(a: Mapping[Key, float], b: Mapping[Key, float]) -> Interval:
    """Return the mean of b - a, over the seeds or episodes that both have.

    Common effects of a seed, such as its noise, cancel in the difference.
    """
    return mean_interval([b[key] - a[key] for key in sorted(a.keys() & b.keys())])


def show(interval: Interval, digits: int, sign: str = "") -> str:
    """Return a mean with its interval; of two units both values, of one its value.

    With `sign` "+" also positive numbers have their sign, as those of differences.
    """
    mean, low, high = (f"{value:{sign}.{digits}f}" for value in (interval.mean, *interval.ends))
    if interval.n == 1:
        return mean
    return f"{low}, {high}" if interval.n == 2 else f"{mean} ({low}{' to ' if sign else '–'}{high})"
