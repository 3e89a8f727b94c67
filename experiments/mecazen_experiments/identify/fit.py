"""Maximum likelihood on windows: values with intervals, noise, and undetermined parameters.

Residuals of windows are normal, with one deviation for position and one for yaw in each group of
runs; both are estimated. Windows of a run are not quite independent, so the intervals are over
sessions, or over blocks of windows of a single session. Intervals from the curvature are given for
comparison.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from mecazen_experiments.identify.models import Model
from mecazen_experiments.identify.runs import Array
from mecazen_experiments.identify.windows import Moments, total
from mecazen_experiments.statistics import jackknife

ROUNDS = 4
"""Number of fits; each uses the noise estimated by the previous fit."""
MAX_CORRELATION = 0.995
"""Parameters with a higher correlation can't be told apart."""
VAGUE = 0.1
"""A parameter with a larger standard deviation [m, rad or 1] is not determined."""

Grouped = Mapping[str, Sequence[Moments]]
"""The moments of each run, by group."""


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval."""

    value: float
    low: float
    high: float
    """Interval over sessions or blocks of windows; NaN without a second one to fit to."""
    curvature: float
    """Half of the interval from the curvature of the likelihood."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a window's residuals."""

    position_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Fit:
    """A model fitted to groups of runs."""

    model: Model
    groups: tuple[str, ...]
    values: Array
    noise: Mapping[str, Noise]

    @property
    def by_name(self) -> dict[str, float]:
        """The values of the free parameters."""
        return dict(zip(self.model.names(self.groups), self.values.tolist(), strict=True))

    def coefficients(self, group: str) -> Array:
        """Return J and the reference's offset for a group (14,)."""
        return self.model.coefficients(self.values, self.groups.index(group))

    def log_likelihood(self, group: str, moments: Moments) -> float:
        """Return the logarithm of the likelihood of windows of a group."""
        errors, noise = moments.errors(self.coefficients(group)), self.noise[group]
        found = 0.0
        for error, sigma, axes in zip(
            errors, (noise.position_m, noise.yaw_rad), (2, 1), strict=True
        ):
            found -= error / (2.0 * sigma**2)
            found -= axes * moments.count * math.log(sigma * math.sqrt(2.0 * math.pi))
        return found


def fit(model: Model, runs: Grouped) -> Fit:
    """Return the fit of a model to runs."""
    return _fit(model, {group: total(runs[group]) for group in sorted(runs)})


def estimates(
    found: Fit, units: Sequence[tuple[str, Moments]]
) -> tuple[dict[str, Estimate], tuple[str, ...]]:
    """Return the parameters with intervals, and sentences on undetermined parameters.

    Args:
        found: The fit.
        units: Group and moments of each independent part of the data.
    """
    spread = _covariance(found, _sums(units))

    def values(kept: Sequence[tuple[str, Moments]]) -> list[float]:
        again = _fit(found.model, _sums(kept), found).by_name
        return [again.get(name, math.nan) for name in found.by_name]  # NaN without the group

    result = {}
    for (name, value), interval, variance in zip(
        found.by_name.items(), jackknife(values, units), np.diag(spread), strict=True
    ):
        half = interval.high - interval.mean if len(units) > 1 else math.nan
        result[name] = Estimate(value, value - half, value + half, 1.96 * math.sqrt(variance))
    return result, ambiguities([*result], spread)


def _sums(units: Sequence[tuple[str, Moments]]) -> dict[str, Moments]:
    """Return the sum of each group, in the order of their names."""
    groups = sorted({group for group, _ in units})
    return {name: total(part for group, part in units if group == name) for name in groups}


def _fit(model: Model, sums: Mapping[str, Moments], near: Fit | None = None) -> Fit:
    """Return the fit to sums of groups; with `near`, start there and keep its noise."""
    groups = tuple(sums)
    values = model.begin(groups)
    if near is not None:
        values = np.array([near.by_name[name] for name in model.names(groups)])
    noise = {group: Noise(1e-3, 1e-3) for group in groups} if near is None else near.noise
    for _ in range(ROUNDS if near is None else 1):
        if len(values):
            roots = [_root(one, noise[group]) for group, one in sums.items()]
            values = least_squares(
                lambda v, roots=roots: _residuals(model, v, roots),
                values,
                x_scale="jac",
                xtol=1e-8 if near is None else 1e-5,
            ).x
        if near is None:
            noise = {
                group: _noise(one, model.coefficients(values, index))
                for index, (group, one) in enumerate(sums.items())
            }
    return Fit(model, groups, values, noise)


def _noise(moments: Moments, coefficients: Array) -> Noise:
    position, yaw = moments.errors(coefficients)
    count = moments.count
    # never 0: residuals of data without noise would have no scale
    return Noise(max(math.sqrt(position / (2 * count)), 1e-9), max(math.sqrt(yaw / count), 1e-9))


def _root(moments: Moments, noise: Noise) -> tuple[Array, Array]:
    """Return A and b such that |A p - b|² is the weighted sum of squares up to a constant."""
    weights = noise.position_m**-2, noise.yaw_rad**-2
    product = sum(w * one for w, one in zip(weights, moments.products, strict=True))
    mixed = sum(w * one for w, one in zip(weights, moments.mixed, strict=True))
    eigenvalues, vectors = np.linalg.eigh(product)
    kept = eigenvalues > 1e-12 * eigenvalues[-1]
    root = np.sqrt(eigenvalues[kept])
    return root[:, None] * vectors[:, kept].T, (vectors[:, kept].T @ mixed) / root


def _residuals(model: Model, values: Array, roots: Sequence[tuple[Array, Array]]) -> Array:
    return np.concatenate(
        [a @ model.coefficients(values, index) - b for index, (a, b) in enumerate(roots)]
    )


def _covariance(found: Fit, sums: Mapping[str, Moments]) -> Array:
    """Return the covariance of the estimates from the curvature of the likelihood."""
    values = found.values
    if not len(values):
        return np.empty((0, 0))
    roots = [_root(one, found.noise[group]) for group, one in sums.items()]
    slopes = np.empty((sum(len(b) for _, b in roots), len(values)))
    for index in range(len(values)):
        step = np.zeros(len(values))
        step[index] = 1e-6 * max(abs(values[index]), 1e-2)
        ahead, behind = (_residuals(found.model, values + d, roots) for d in (step, -step))
        slopes[:, index] = (ahead - behind) / (2.0 * step[index])
    return covariance(slopes)


def covariance(slopes: Array) -> Array:
    """Return the covariance of parameters of a fit.

    Args:
        slopes: Derivatives of the residuals, which have a standard deviation of 1 (m, p).
    """
    # a parameter without influence has a huge deviation
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-100)
    eigenvalues, vectors = np.linalg.eigh((slopes / scale).T @ (slopes / scale))
    inverse = (vectors / np.maximum(eigenvalues, 1e-15)) @ vectors.T
    return np.asarray(inverse / np.outer(scale, scale))


def ambiguities(names: Sequence[str], covariance: Array) -> tuple[str, ...]:
    """Return sentences on parameters that the data do not determine."""
    deviations = np.sqrt(np.diag(covariance))
    vague = [not deviation < VAGUE for deviation in deviations]
    lines = [
        f"{name} is not determined: the motion hardly depends on it"
        for name, is_vague in zip(names, vague, strict=True)
        if is_vague
    ]
    kept = [index for index, is_vague in enumerate(vague) if not is_vague]
    for at, one in enumerate(kept):
        for other in kept[at + 1 :]:
            correlation = covariance[one, other] / (deviations[one] * deviations[other])
            if abs(correlation) > MAX_CORRELATION:
                lines.append(
                    f"{names[one]} and {names[other]} can't be told apart: their correlation is "
                    f"{correlation:.3f}"
                )
    return tuple(lines)
