"""Kinematic models and their fit by maximum likelihood.

A model is a matrix J (3, 4) that maps the rotation of the wheels [rad] to the motion of the
robot [m, m, rad]. With radius R, lever l and lateral gain g,

    J = R/4 · [[1, 1, 1, 1], [-g, g, g, -g]/c, [-1, 1, -1, 1]/l],     c = ±cot γ of the rollers.

The ideal kinematics have g = 1; a wheel of N rollers has g = sin(π/N)/(π/N).

Residuals of windows are normal, with one deviation for position and one for yaw in each group of
runs; both are estimated. Windows of a run are not quite independent, so the intervals are over
sessions, or over blocks of windows of a single session.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

import numpy as np
from mecazen.robot import Robot
from mecazen_tools.statistics import Interval, mean_interval
from scipy.optimize import least_squares

from mecazen_experiments.identify.data import Array
from mecazen_experiments.identify.windows import Moments, gains, ideal_matrix, in_reference, total

FRAME = ("misalignment_rad", "offset_x_m", "offset_y_m")
"""Mounting of the reference on the robot: its yaw, and its position from the wheels' centre."""
ROUNDS = 4
"""Number of fits; each uses the noise estimated by the previous fit."""
MAX_CORRELATION = 0.995
"""Parameters with a higher correlation can't be told apart."""
VAGUE = 0.1
"""A parameter with a larger standard deviation [m, rad or 1] is not determined."""

T = TypeVar("T")
Unit = tuple[str, Moments]
"""Group and moments of an independent part of the data."""
Noise = tuple[float, float]
"""Standard deviations of a window's residuals of position [m] and yaw [rad]."""


@dataclass(frozen=True)
class Model:
    """Kinematics with radius and lever as parameters; each group of runs also has `FRAME`."""

    name: str
    robot: Robot
    lateral_gain: float | None = None
    """None if it is a parameter."""

    @property
    def start(self) -> dict[str, float]:
        """The parameters, with the values from which a fit begins."""
        free = {} if self.lateral_gain is not None else {"lateral_gain": 1.0}
        return {"radius_m": self.robot.wheels.radius_m, "lever_m": self.robot.lever, **free}

    def names(self, groups: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all parameters."""
        frames = [f"{name} of {group}" if group else name for group in groups for name in FRAME]
        return (*self.start, *frames)

    def mounting(self, values: Array, group: int) -> Array:
        """Return misalignment [rad] and offset [m] of a group (3,)."""
        return values[len(self.start) + 3 * group :][:3]

    def coefficients(self, values: Array, group: int) -> Array:
        """Return J in the reference's frame, and the reference's offset, for a group (14,)."""
        gain = values[2] if self.lateral_gain is None else self.lateral_gain
        j = ideal_matrix(self.robot, values[0], values[1], gain)
        return in_reference(j, self.mounting(values, group))


@dataclass(frozen=True)
class Fit:
    """A model fitted to groups of runs."""

    model: Model
    groups: tuple[str, ...]
    values: Array
    noise: Mapping[str, Noise]
    slopes: Array
    """Derivatives of the residuals in units of their noise (m, p)."""
    log_likelihood: float
    """Logarithm of the likelihood of all windows."""

    @property
    def by_name(self) -> dict[str, float]:
        """The values of the free parameters."""
        return dict(zip(self.model.names(self.groups), self.values.tolist(), strict=True))

    def mounting(self, group: str) -> Array:
        """Return misalignment [rad] and offset [m] of a group (3,)."""
        return self.model.mounting(self.values, self.groups.index(group))

    def coefficients(self, group: str) -> Array:
        """Return J and the reference's offset for a group (14,)."""
        return self.model.coefficients(self.values, self.groups.index(group))


def fit(model: Model, units: Sequence[Unit], near: Fit | None = None) -> Fit:
    """Return the fit of a model to parts of the data.

    With `near`, a fit to more parts, start there and keep its noise.
    """
    groups = tuple(sorted({group for group, _ in units}))
    sums = {name: total(part for group, part in units if group == name) for name in groups}
    names = model.names(groups)
    if near is None:
        noise: Mapping[str, Noise] = dict.fromkeys(groups, (1e-3, 1e-3))
        turns = (gains(moments)[1] for moments in sums.values())
        start = {**model.start, **dict(zip(names[len(model.start) :: 3], turns, strict=True))}
    else:
        noise, start = near.noise, near.by_name
    values = np.array([start.get(name, 0.0) for name in names])
    for _ in range(ROUNDS if near is None else 1):
        roots = [_root(moments, noise[group]) for group, moments in sums.items()]
        solution = least_squares(
            lambda v, roots=roots: np.concatenate(
                [a @ model.coefficients(v, index) - b for index, (a, b) in enumerate(roots)]
            ),
            values,
            x_scale="jac",
            xtol=1e-8 if near is None else 1e-5,
        )
        values = solution.x
        errors = {
            group: moments.errors(model.coefficients(values, index)).tolist()
            for index, (group, moments) in enumerate(sums.items())
        }
        if near is None:
            # never 0: residuals of data without noise would have no scale
            noise = {
                group: (
                    max(math.sqrt(position / (2 * sums[group].count)), 1e-9),
                    max(math.sqrt(yaw / sums[group].count), 1e-9),
                )
                for group, (position, yaw) in errors.items()
            }
    likelihood = 0.0
    for group, moments in sums.items():
        for error, sigma, axes in zip(errors[group], noise[group], (2, 1), strict=True):
            likelihood -= error / (2.0 * sigma**2)
            likelihood -= axes * moments.count * math.log(sigma * math.sqrt(2.0 * math.pi))
    return Fit(model, groups, values, noise, solution.jac, likelihood)


def estimates(fitted: Fit, units: Sequence[Unit]) -> dict[str, Interval]:
    """Return the parameters of a fit with their intervals over independent parts of the data."""

    def values(kept: Sequence[Unit]) -> list[float]:
        again = fit(fitted.model, kept, fitted).by_name
        return [again.get(name, math.nan) for name in fitted.by_name]  # NaN without the group

    result = {}
    for (name, value), interval in zip(
        fitted.by_name.items(), jackknife(values, units), strict=True
    ):
        half = interval.high - interval.mean
        result[name] = Interval(value, value - half, value + half, interval.n)
    return result


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


def _root(moments: Moments, noise: Noise) -> tuple[Array, Array]:
    """Return A and b such that |A p - b|² is the weighted sum of squares up to a constant."""
    position, yaw = (sigma**-2 for sigma in noise)
    product = position * moments.products[0] + yaw * moments.products[1]
    mixed = position * moments.mixed[0] + yaw * moments.mixed[1]
    eigenvalues, vectors = np.linalg.eigh(product)
    kept = eigenvalues > 1e-12 * eigenvalues[-1]
    root = np.sqrt(eigenvalues[kept])
    return root[:, None] * vectors[:, kept].T, (vectors[:, kept].T @ mixed) / root


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
    is_clear = deviations < VAGUE
    lines = [
        f"{name} is not determined: the motion hardly depends on it"
        for name, clear in zip(names, is_clear, strict=True)
        if not clear
    ]
    for i, j in combinations(np.flatnonzero(is_clear).tolist(), 2):
        correlation = covariance[i, j] / (deviations[i] * deviations[j])
        if abs(correlation) > MAX_CORRELATION:
            lines.append(
                f"{names[i]} and {names[j]} can't be told apart: their correlation is "
                f"{correlation:.3f}"
            )
    return tuple(lines)
