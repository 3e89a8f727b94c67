"""Identifies motors from commands, wheel positions and efforts.

The wheels follow commands as in `mecazen.robot.RealMotors`: delay, dead band, gain, supply, then a
first-order lag. The response to commands that are constant between samples is exact, so the delay
need not be a multiple of the sampling period. Friction is found from the motors' efforts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from mecazen.robot import WHEELS, RealMotors
from mecazen_tools.statistics import Interval
from scipy.optimize import least_squares
from scipy.signal import lfilter

from mecazen_experiments.identify.data import Array, MotorLog
from mecazen_experiments.identify.models import ambiguities, covariance
from mecazen_experiments.identify.windows import SIDES, TURNS

MAX_DELAY_S = 0.2
LAGS_S = (0.01, 0.05, 0.2)
"""Time constants from which a fit may begin."""
NOISELESS_RAD_S = 1e-6
"""Deviation of speeds in data without noise."""
MOVING_RAD_S, STEADY_RAD_S2, STRAIGHT = 0.5, 0.5, 0.1
"""Friction is found in intervals with at least the first speed and at most the second acceleration,
in which the wheels turn the robot or push it aside by at most the third share of the forward
push."""
NAMES = (
    "delay_s",
    "time_constant_s",
    "dead_band_rad_s",
    "sag_per_nm",
    *(f"gain of {wheel}" for wheel in WHEELS),
)


def response(values: Array, log: MotorLog) -> tuple[Array, Array]:
    """Return the wheels' speeds at the end of each interval, and their means during it (n, 4).

    Args:
        values: The parameters `NAMES`.
        log: Commands and loads.
    """
    delay, lag, dead, sag = values[:4]
    period, lag = log.period_s, max(lag, 1e-6)
    commands = np.sign(log.commands) * np.maximum(np.abs(log.commands) - dead, 0.0) * values[4:]
    whole = math.floor(delay / period)
    remainder = delay - whole * period
    load = np.zeros(len(commands))  # the motors' absolute torques at the beginning of each interval
    if log.efforts is not None:
        load[1:] = np.abs(log.efforts).sum(axis=1)[:-1]
    supplied = np.maximum(1.0 - sag * load, 0.0)[:, None]
    first, then = (_late(commands, steps) * supplied for steps in (whole + 1, whole))
    keep, keep_then = math.exp(-period / lag), math.exp(-(period - remainder) / lag)
    ends = lfilter(
        [1.0], [1.0, -keep], (keep_then - keep) * first + (1.0 - keep_then) * then, axis=0
    )
    begins = np.concatenate([np.zeros((1, 4)), ends[:-1]])
    middles = first + (begins - first) * math.exp(-remainder / lag)
    turned = first * remainder + (begins - first) * lag * (1.0 - math.exp(-remainder / lag))
    turned += then * (period - remainder) + (middles - then) * lag * (1.0 - keep_then)
    return np.asarray(ends), turned / period


def _late(values: Array, steps: int) -> Array:
    """Return the rows delayed by `steps` rows; the first rows are zero."""
    steps = min(steps, len(values))
    return np.concatenate([np.zeros((steps, values.shape[1])), values[: len(values) - steps]])


def identify_motors(logs: Sequence[MotorLog]) -> tuple[dict[str, Interval], tuple[str, ...]]:
    """Return the parameters of the motors, and sentences on undetermined parameters.

    Intervals are from the curvature. Friction is included if efforts are recorded.
    """

    def residuals(values: Array) -> Array:
        return np.concatenate([(response(values, log)[1] - log.speeds).ravel() for log in logs])

    starts = [
        np.array([delay, lag, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
        for delay in np.arange(0.0, MAX_DELAY_S, 2.0 * logs[0].period_s)
        for lag in LAGS_S
    ]
    start = min(starts, key=lambda values: float(np.square(residuals(values)).sum()))
    has_load = any(log.efforts is not None for log in logs)
    upper = np.array([2.0 * MAX_DELAY_S, 10.0, 100.0, 1.0 if has_load else 1e-9, *[10.0] * 4])
    solution = least_squares(
        residuals,
        np.clip(start, 1e-9, upper / 2.0),
        bounds=(np.zeros(len(NAMES)), upper),
        x_scale=np.array([0.01, 0.05, 0.1, 0.01, 1.0, 1.0, 1.0, 1.0]),
        diff_step=1e-4,
    )
    deviation = max(math.sqrt(2.0 * solution.cost / len(solution.fun)), NOISELESS_RAD_S)
    spread = covariance(solution.jac / deviation)
    halves = 1.96 * np.sqrt(np.diag(spread))
    known = [index for index, name in enumerate(NAMES) if has_load or name != "sag_per_nm"]
    lines = ambiguities([NAMES[index] for index in known], spread[np.ix_(known, known)])
    result = {NAMES[i]: _interval(solution.x[i], halves[i], len(solution.fun)) for i in known}
    if has_load:
        result |= _friction(logs, solution.x)
    return result, lines


def _interval(value: float, half: float, count: int) -> Interval:
    return Interval(float(value), float(value - half), float(value + half), count)


def _friction(logs: Sequence[MotorLog], values: Array) -> dict[str, Interval]:
    """Return Coulomb and viscous friction from the efforts while the robot drives steadily ahead.

    In these intervals rollers do not spin, and nothing accelerates. Wheels with different gains
    work against each other, so rollers slip; their grip adds a torque in the direction of the slip.
    """
    twist = SIDES * TURNS
    rows, efforts = [], []
    for log in logs:
        if log.efforts is None:
            continue
        speeds, _ = response(values, log)
        changes = np.diff(speeds, axis=0, prepend=speeds[:1]) / log.period_s
        ahead = np.abs(speeds.sum(axis=1))
        astray = np.maximum(np.abs(speeds @ SIDES), np.abs(speeds @ TURNS))
        chosen = (astray < STRAIGHT * ahead) & (np.abs(changes).max(axis=1) < STEADY_RAD_S2)
        chosen &= ahead > 4.0 * MOVING_RAD_S
        steady = speeds[chosen]
        slip = np.sign(steady @ twist)[:, None] * twist
        rows.append(np.stack([np.sign(steady), steady, slip], axis=2).reshape(-1, 3))
        efforts.append(log.efforts[chosen].reshape(-1))
    design, effort = np.concatenate(rows), np.concatenate(efforts)
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return {}
    friction, *_ = np.linalg.lstsq(design, effort, rcond=None)
    variance = float(np.mean(np.square(effort - design @ friction)))
    halves = 1.96 * np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    return {
        "coulomb_nm": _interval(friction[0], halves[0], len(effort)),
        "viscous_nms": _interval(friction[1], halves[1], len(effort)),
    }


def identified_motors(parameters: Mapping[str, Interval]) -> RealMotors:
    """Return the motors of the robot file."""
    values = {name: max(interval.mean, 0.0) for name, interval in parameters.items()}
    gains = [round(values[f"gain of {wheel}"], 5) for wheel in WHEELS]
    common = {
        name: round(values[name], 6)
        for name in (*NAMES[:4], "coulomb_nm", "viscous_nms")
        if name in values
    }
    return RealMotors(gains=(gains[0], gains[1], gains[2], gains[3]), **common)
