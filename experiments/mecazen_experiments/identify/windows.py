"""Windows of runs, and sums over windows, to which kinematic models are fitted.

A robot whose wheels turn by dφ (4) moves by J dφ in its own frame, with the matrix J (3, 4) of
its model: along x, along y, and yaw. Let θ be the yaw of the reference relative to the beginning of
a window. Over the window, the reference moves, in its frame at the beginning, by

    Δx = Σ (cos θ·J_x - sin θ·J_y) dφ + (cos Δθ - 1)·o_x - sin Δθ·o_y
    Δy = Σ (sin θ·J_x + cos θ·J_y) dφ + sin Δθ·o_x + (cos Δθ - 1)·o_y
    Δθ = Σ J_yaw dφ

with the offset o of the reference on the robot. The motion is linear in the 14 coefficients J and
o. So the sum of squares of all windows is a quadratic form in these coefficients, which `Moments`
contains. A fit to moments takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np

from mecazen_experiments.identify.runs import Array, Run

COEFFICIENTS = 14
"""J_x (4), J_y (4), J_yaw (4) and o (2)."""


@dataclass(frozen=True)
class Windows:
    """Windows of a run."""

    starts_s: Array
    """Begin times of the windows (m,) [s]."""
    moved: Array
    """Δx [m], Δy [m] and Δθ [rad] of the reference (m, 3)."""
    slopes: Array
    """Derivatives of the motion with respect to the coefficients (m, 3, 14)."""

    def residuals(self, coefficients: Array) -> Array:
        """Return the reference's motion minus that of a model (m, 3)."""
        return self.moved - self.slopes @ coefficients

    def blocks(self, size: int) -> Iterator[Windows]:
        """Yield blocks of at most `size` consecutive windows."""
        for begin in range(0, len(self.moved), size):
            part = slice(begin, begin + size)
            yield Windows(self.starts_s[part], self.moved[part], self.slopes[part])


def cut(run: Run, window_s: float, offset_s: float = 0.0) -> Windows:
    """Return consecutive windows of a run.

    Args:
        run: The run.
        window_s: Duration of a window [s].
        offset_s: Offset of the reference's clock ahead of that of the wheels [s].
    """
    size = max(1, round(window_s / run.period_s))
    poses, margin = run.poses, 0
    if offset_s:
        at = run.times + offset_s
        poses = np.stack([np.interp(at, run.times, column) for column in poses.T], axis=1)
        margin = round(abs(offset_s) / run.period_s) + 1
    first = run.starts(size, margin)
    yaw = poses[:, 2]
    inside = first[:, None] + np.arange(size)
    # the yaw in the middle of each step
    middle = (yaw[inside] + yaw[inside + 1]) / 2.0 - yaw[first][:, None]
    steps = np.diff(run.wheels, axis=0)[inside]
    along = np.einsum("mk,mkw->mw", np.cos(middle), steps)
    across = np.einsum("mk,mkw->mw", np.sin(middle), steps)
    moved = motions(poses, first, size)
    slopes = np.zeros((len(first), 3, COEFFICIENTS))
    slopes[:, 0, 0:4], slopes[:, 0, 4:8] = along, -across
    slopes[:, 1, 0:4], slopes[:, 1, 4:8] = across, along
    slopes[:, 2, 8:12] = steps.sum(axis=1)
    cosine, sine = np.cos(moved[:, 2]) - 1.0, np.sin(moved[:, 2])
    slopes[:, 0, 12], slopes[:, 0, 13] = cosine, -sine
    slopes[:, 1, 12], slopes[:, 1, 13] = sine, cosine
    return Windows(run.times[first], moved, slopes)


def motions(poses: Array, first: Array | Iterable[int], size: int) -> Array:
    """Return the motion over `size` samples from each sample in `first`, in its frame (m, 3)."""
    first = np.asarray(first, dtype=int)
    begin, end = poses[first], poses[first + size]
    c, s = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    x, y, yaw = (end - begin).T
    return np.stack([c * x + s * y, c * y - s * x, yaw], axis=1)


@dataclass(frozen=True)
class Moments:
    """Sums over windows; the first entry of each pair is for Δx and Δy, the second for Δθ."""

    count: int
    """Number of windows."""
    products: tuple[Array, Array]
    """Sums of products of slopes (14, 14)."""
    mixed: tuple[Array, Array]
    """Sums of products of slopes and motion (14,)."""
    squares: tuple[float, float]
    """Sums of squares of the motion."""

    @staticmethod
    def of(windows: Windows) -> Moments:
        """Return the moments of windows."""
        products, mixed, squares = [], [], []
        for rows in (slice(0, 2), slice(2, 3)):
            slopes = windows.slopes[:, rows].reshape(-1, COEFFICIENTS)
            moved = windows.moved[:, rows].reshape(-1)
            products.append(slopes.T @ slopes)
            mixed.append(slopes.T @ moved)
            squares.append(float(moved @ moved))
        return Moments(
            len(windows.moved),
            (products[0], products[1]),
            (mixed[0], mixed[1]),
            (squares[0], squares[1]),
        )

    def __add__(self, other: Moments) -> Moments:
        return Moments(
            self.count + other.count,
            (self.products[0] + other.products[0], self.products[1] + other.products[1]),
            (self.mixed[0] + other.mixed[0], self.mixed[1] + other.mixed[1]),
            (self.squares[0] + other.squares[0], self.squares[1] + other.squares[1]),
        )

    def errors(self, coefficients: Array) -> tuple[float, float]:
        """Return the sums of squared residuals of Δx and Δy, and of Δθ."""
        position, yaw = (
            square - 2.0 * mixed @ coefficients + coefficients @ products @ coefficients
            for square, mixed, products in zip(self.squares, self.mixed, self.products, strict=True)
        )
        return max(float(position), 0.0), max(float(yaw), 0.0)


def total(moments: Iterable[Moments]) -> Moments:
    """Return the sum of one or more moments."""
    return reduce(Moments.__add__, moments)
