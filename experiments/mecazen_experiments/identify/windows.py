"""Windows of runs: sums to which models are fitted, checks of the wheels' columns, and drift.

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

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt
from mecazen.errors import ConfigError
from mecazen.robot import WHEELS, Robot

from mecazen_experiments.identify.data import Array, Run

WINDOW_S = 0.5
"""Duration of a window: long enough for motion far beyond the reference's noise, short enough for
little yaw."""
BLOCK = 20
"""Number of windows of a block: residuals of neighbours are not independent."""
COEFFICIENTS = 14
"""J_x (4), J_y (4), J_yaw (4) and o (2)."""
SIDES = np.array([-1.0, 1.0, 1.0, -1.0])
"""Direction in which each wheel pushes the robot along y."""
TURNS = np.array([-1.0, 1.0, -1.0, 1.0])
"""Direction in which each wheel turns the robot."""
SUSPICIOUS = 0.2
"""Residuals above this share of the motion cannot be explained by noise."""
UNIT_RATIO = 3.0
"""Maximum factor between the identified radius and that of the robot file."""


@dataclass(frozen=True)
class Moments:
    """Sums over windows; the first row of each array is for Δx and Δy, the second for Δθ."""

    count: int
    """Number of windows."""
    products: Array
    """Sums of products of slopes (2, 14, 14)."""
    mixed: Array
    """Sums of products of slopes and motion (2, 14)."""
    squares: Array
    """Sums of squares of the motion (2,)."""

    def __add__(self, more: Moments) -> Moments:
        return Moments(
            self.count + more.count,
            self.products + more.products,
            self.mixed + more.mixed,
            self.squares + more.squares,
        )

    def errors(self, coefficients: Array) -> Array:
        """Return the sums of squared residuals of Δx and Δy, and of Δθ (2,)."""
        errors = [
            square - 2.0 * mixed @ coefficients + coefficients @ products @ coefficients
            for square, mixed, products in zip(self.squares, self.mixed, self.products, strict=True)
        ]
        return np.maximum(errors, 0.0)


def total(moments: Iterable[Moments]) -> Moments:
    """Return the sum of one or more moments."""
    return reduce(Moments.__add__, moments)


def blocks(run: Run, offset_s: float = 0.0) -> list[Moments]:
    """Return the moments of blocks of consecutive windows; `offset_s` is that of `cut`."""
    moved, slopes = cut(run, offset_s)
    begins = range(0, len(moved), BLOCK)
    return [_moments(moved[begin:][:BLOCK], slopes[begin:][:BLOCK]) for begin in begins]


def moments(run: Run, offset_s: float = 0.0) -> Moments:
    """Return the moments of all windows of a run; `offset_s` is that of `cut`."""
    return _moments(*cut(run, offset_s))


def _moments(moved: Array, slopes: Array) -> Moments:
    products, mixed, squares = [], [], []
    for rows in (slice(0, 2), slice(2, 3)):
        a, b = slopes[:, rows].reshape(-1, COEFFICIENTS), moved[:, rows].reshape(-1)
        products.append(a.T @ a)
        mixed.append(a.T @ b)
        squares.append(b @ b)
    return Moments(len(moved), np.array(products), np.array(mixed), np.array(squares))


def cut(run: Run, offset_s: float = 0.0) -> tuple[Array, Array]:
    """Return the motion Δx, Δy, Δθ of the reference in consecutive windows, and its slopes.

    Args:
        run: The run.
        offset_s: Offset of the reference's clock ahead of that of the wheels [s].

    Returns:
        The motion [m, m, rad] (m, 3), and its derivatives with respect to the coefficients
        (m, 3, 14).
    """
    size = max(1, round(WINDOW_S / run.period_s))
    poses, margin = run.poses, 0
    if offset_s:
        times = run.times + offset_s
        poses = np.stack([np.interp(times, run.times, column) for column in poses.T], axis=1)
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
    return moved, slopes


def motions(poses: Array, first: npt.NDArray[np.int_], size: int) -> Array:
    """Return the motion over `size` samples from each sample in `first`, in its frame (m, 3)."""
    begin, end = poses[first], poses[first + size]
    c, s = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    x, y, yaw = (end - begin).T
    return np.stack([c * x + s * y, c * y - s * x, yaw], axis=1)


def gains(sums: Moments) -> tuple[Array, float, float]:
    """Return the gains of a robot, the yaw of the reference on it [rad], and what is unexplained.

    The gains are f, l and t in J = [f·1, l·SIDES, t·TURNS] (3,). A reference that is turned by β
    moves by [[cos β, sin β], [-sin β, cos β]]·diag(f, l) with the patterns of x and y; turns within
    45°, and those with which a gain would be negative, are 0. The third value is the squares of
    the residuals relative to those of the motion, with equal weight of position and yaw.
    """
    basis = np.zeros((COEFFICIENTS, 7))
    basis[0:4, 0], basis[4:8, 1], basis[8:12, 2] = 1.0, SIDES, TURNS
    basis[0:4, 3], basis[4:8, 4] = SIDES, 1.0
    basis[12, 5] = basis[13, 6] = 1.0
    weights = 1.0 / np.maximum(sums.squares, 1e-30)
    left = basis.T @ (weights[0] * sums.products[0] + weights[1] * sums.products[1]) @ basis
    right = basis.T @ (weights[0] * sums.mixed[0] + weights[1] * sums.mixed[1])
    solution = np.linalg.lstsq(left, right, rcond=None)[0]
    xx, yy, yaw, xy, yx = solution[:5].tolist()
    residual = max(float(2.0 - right @ solution) / 2.0, 0.0)
    size = max(math.hypot(xx, yx), math.hypot(yy, xy))
    is_possible = xx * yy - xy * yx >= -0.1 * size**2 and yaw > 0.0
    turn = math.atan2(xy - yx, xx + yy) if is_possible else 0.0
    if abs(turn) <= math.pi / 4.0:
        return np.array([xx, yy, yaw]), 0.0, residual
    c, s = math.cos(turn), math.sin(turn)
    return np.array([c * xx - s * yx, s * xy + c * yy, yaw]), turn, residual


def ideal_matrix(robot: Robot, radius: float, lever: float, lateral_gain: float = 1.0) -> Array:
    """Return J (3, 4) of a robot with other radius [m], lever [m] and lateral gain."""
    rows = np.ones(4), SIDES * lateral_gain / robot.cross_gain, TURNS / lever
    return radius / 4.0 * np.stack(rows)


def in_reference(j: Array, mounting: Array) -> Array:
    """Return the coefficients of J (3, 4) for a reference with misalignment and offset (14,)."""
    turn, x, y = mounting
    c, s = math.cos(turn), math.sin(turn)
    return np.concatenate([c * j[0] + s * j[1], c * j[1] - s * j[0], j[2], [x, y]])


def check_wheels(name: str, sums: Moments, robot: Robot) -> None:
    """Refuse wheels that are swapped, that turn backwards, or have a wrong unit.

    Raises:
        ConfigError: One line with the reason.
    """
    if sums.count == 0 or min(sums.squares) == 0.0:
        raise ConfigError(f"{name}: the reference must move and turn")
    patterns, turn, residual = gains(sums)
    shape = in_reference(ideal_matrix(robot, 1.0, robot.lever), np.array([turn, 0.0, 0.0]))
    radius = abs(float(sums.mixed[0] @ shape / (shape @ sums.products[0] @ shape)))
    nominal = robot.wheels.radius_m
    expected = ideal_matrix(robot, nominal, robot.lever)[:, 1]
    if residual > SUSPICIOUS**2 or np.any(patterns < -0.5 * expected):
        raise ConfigError(
            f"{name}: the wheels do not explain the reference's motion; check that they are in the "
            f"order {', '.join(WHEELS)}, that each turns forward as the robot does, and that time "
            "is in seconds and all angles in radians"
        )
    if not 1.0 / UNIT_RATIO < radius / nominal < UNIT_RATIO:
        raise ConfigError(
            f"{name}: wheels of radius {radius:.3g} m would fit, but the robot file has "
            f"{nominal:g} m; angles and positions must be in the units of the format"
        )


def odometry(run: Run, coefficients: Array) -> Array:
    """Return the poses of the reference (n, 3) that a model predicts from the wheels' angles.

    Args:
        run: The run.
        coefficients: J, in the reference's frame, and the reference's offset (14,).
    """
    steps = np.diff(run.wheels, axis=0) @ coefficients[:12].reshape(3, 4).T
    return shifted(integrated(steps), coefficients[12:])


def integrated(steps: Array) -> Array:
    """Return the poses (n + 1, 3) after steps in the robot's frame (n, 3), starting at 0."""
    yaw = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    middle = (yaw[1:] + yaw[:-1]) / 2.0
    c, s = np.cos(middle), np.sin(middle)
    x = np.concatenate([[0.0], np.cumsum(c * steps[:, 0] - s * steps[:, 1])])
    y = np.concatenate([[0.0], np.cumsum(s * steps[:, 0] + c * steps[:, 1])])
    return np.stack([x, y, yaw], axis=1)


def shifted(poses: Array, offset: Array) -> Array:
    """Return the poses of a point with an offset [m] in the frame of the given poses (n, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * offset[0] - s * offset[1]
    y = poses[:, 1] + s * offset[0] + c * offset[1]
    return np.stack([x, y, poses[:, 2]], axis=1)


def mounted(poses: Array, mounting: Array) -> Array:
    """Return poses of the reference for poses of the wheels' centre (n, 3).

    Args:
        poses: Poses of the wheels' centre (n, 3).
        mounting: Misalignment [rad] and offset [m] of the reference (3,).
    """
    return shifted(poses + np.array([0.0, 0.0, mounting[0]]), mounting[1:])


def drifts(run: Run, poses: Array, horizon_s: float) -> Array:
    """Return the drift of `poses` in consecutive spans of the run: [m] and [rad] (m, 2).

    In each span, `poses` begin at the reference's pose. Spans with a gap are left out.
    """
    size = max(1, round(horizon_s / run.period_s))
    first = run.starts(size)
    error = motions(run.poses, first, size) - motions(poses, first, size)
    yaw = np.abs(np.remainder(error[:, 2] + np.pi, 2.0 * np.pi) - np.pi)
    return np.stack([np.hypot(error[:, 0], error[:, 1]), yaw], axis=1)
