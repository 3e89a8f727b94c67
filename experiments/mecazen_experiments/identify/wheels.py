"""Checks order, direction and unit of the columns of the wheels."""

from __future__ import annotations

import math
from itertools import permutations, product

import numpy as np
from mecazen.errors import ConfigError
from mecazen.robot import WHEELS

from mecazen_experiments.identify.models import SIDES, TURNS, Nominal
from mecazen_experiments.identify.runs import Array
from mecazen_experiments.identify.windows import Moments

SUSPICIOUS = 0.2
"""Residuals above this share of the motion cannot be explained by noise."""
EQUAL = 1.1
"""Explanations whose residuals differ by less than this factor are equally good."""
UNIT_RATIO = 3.0
"""Maximum factor between identified radius and lever and those of the robot file."""
DEGREES = 180.0 / np.pi


def gains(moments: Moments) -> tuple[Array, float]:
    """Return forward, lateral and yaw gain, and the squared residuals relative to the motion.

    The gains are f, l and t in J = [f·1, l·SIDES, t·TURNS].
    """
    found, residual = _pattern_gains(moments)
    return found[:3], residual


def _pattern_gains(
    moments: Moments, order: tuple[int, ...] = (0, 1, 2, 3), signs: Array | None = None
) -> tuple[Array, float]:
    """Return gains of wheel patterns, and the squared residuals relative to the motion.

    The gains are those of x, y and yaw with their own patterns, of x with the pattern of y and of
    y with that of x, as with a reference that is mounted at an angle, and the offset (7,).
    Position and yaw have equal weight in the residuals.

    Args:
        moments: Sums over windows.
        order: Column of each wheel.
        signs: Direction of each column.
    """
    basis = np.zeros((14, 7))
    columns = np.asarray(order)
    direction = np.ones(4) if signs is None else signs
    for row, (pattern, column) in enumerate(((np.ones(4), 0), (SIDES, 1), (TURNS, 2))):
        basis[4 * row + columns, column] = pattern * direction[columns]
    basis[columns, 3], basis[4 + columns, 4] = SIDES * direction[columns], direction[columns]
    basis[12, 5] = basis[13, 6] = 1.0
    weights = [1.0 / max(square, 1e-30) for square in moments.squares]
    left = basis.T @ sum(w * p for w, p in zip(weights, moments.products, strict=True)) @ basis
    right = basis.T @ sum(w * x for w, x in zip(weights, moments.mixed, strict=True))
    found: Array = np.linalg.lstsq(left, right, rcond=None)[0].astype(float)
    return found, max(float(2.0 - right @ found) / 2.0, 0.0)


def mounting(moments: Moments) -> float:
    """Return the yaw of the reference on the robot [rad]; 0 within 45°, or if none explains it."""
    turn = _turn(_pattern_gains(moments)[0]) or 0.0
    return turn if abs(turn) > math.pi / 4.0 else 0.0


def _turn(gains: Array) -> float | None:
    """Return the yaw of the reference on the robot; None if the gains need wrong wheels.

    A reference that is turned by β moves by [[cos β, sin β], [-sin β, cos β]]·diag(f, l) with the
    patterns of x and y, where f, l and the gain of yaw are positive.
    """
    (xx, yy, yaw, xy, yx), lateral = gains[:5], math.hypot(gains[1], gains[3])
    forward = math.hypot(xx, yx)
    is_mirrored = xx * yy - xy * yx < -0.1 * max(forward, lateral) ** 2
    return None if is_mirrored or yaw <= 0.0 else math.atan2(xy - yx, xx + yy)


def check_wheels(name: str, moments: Moments, nominal: Nominal) -> None:
    """Refuse wheels that are swapped, that turn the wrong way, or have a wrong unit.

    Raises:
        ConfigError: One line with the wheels and the residuals.
    """
    if moments.count == 0 or min(moments.squares) == 0.0:
        raise ConfigError(f"{name}: the reference must move and turn")
    # one number for each of position and yaw, so that motion along a single axis is enough
    shape = np.concatenate([nominal.matrix(1.0, nominal.lever).ravel(), np.zeros(2)])
    radius, turning = (
        abs(float(mixed @ shape / (shape @ products @ shape)))
        for mixed, products in zip(moments.mixed, moments.products, strict=True)
    )
    if _near(turning, DEGREES * nominal.radius) and not _near(radius, turning):
        raise ConfigError(
            f"{name}: yaw turns {turning / nominal.radius:.3g} times as far as the wheels turn "
            "the robot: it must be in radians, not degrees"
        )
    found, residual = gains(moments)
    expected = nominal.matrix(nominal.radius, nominal.lever)[:, 1]
    share = float(np.sqrt(residual))
    if share > SUSPICIOUS or np.any(found < -0.5 * expected):
        _explain(name, moments, share)
    if not _near(radius, nominal.radius):
        raise ConfigError(
            f"{name}: wheels of radius {radius:.3g} m would fit, but the robot file has "
            f"{nominal.radius:g} m; angles and positions must be in the units of the format"
        )


def _near(one: float, other: float) -> bool:
    return 1.0 / UNIT_RATIO < one / other < UNIT_RATIO


def _explain(name: str, moments: Moments, share: float) -> None:
    """Raise an error with the fewest changes of order and directions that explain the motion."""
    choices = []
    for order, signs in product(permutations(range(4)), product((1.0, -1.0), repeat=4)):
        found, residual = _pattern_gains(moments, order, np.array(signs))
        turn = _turn(found)
        if turn is not None:
            count = sum(o != w for w, o in enumerate(order)) + sum(sign < 0.0 for sign in signs)
            choices.append((float(np.sqrt(residual)), order, signs, (count, abs(turn))))
    best = min(residual for residual, *_ in choices)
    equal = (choice for choice in choices if choice[0] <= EQUAL * best)
    residual, order, signs, _ = min(equal, key=lambda choice: choice[3])
    swapped = [WHEELS[wheel] for wheel in range(4) if order[wheel] != wheel]
    backwards = [WHEELS[column] for column in range(4) if signs[column] < 0.0]
    if residual > SUSPICIOUS or (not swapped and not backwards):
        raise ConfigError(
            f"{name}: the wheels do not explain the reference's motion: {share:.0%} of it is left; "
            "check the columns of the wheels, and that time is in seconds and all angles in radians"
        )
    what = " and ".join(
        [f"{' and '.join(swapped)} are swapped"] * bool(swapped)
        + [f"{' and '.join(backwards)} turn backwards"] * bool(backwards)
    )
    raise ConfigError(
        f"{name}: {what}: changed, they leave {residual:.0%} of the reference's motion "
        f"unexplained instead of {share:.0%}"
    )
