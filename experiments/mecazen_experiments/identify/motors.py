"""Identifies motors from commands and wheel positions.

The wheels follow commands as in `mecazen.robot.RealMotors`: delay, dead band, gain, then a
first-order lag. The response to commands that are constant between samples is exact, so the delay
need not be a multiple of the sampling period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from mecazen.robot import WHEELS, RealMotors
from mecazen_tools.statistics import Interval
from scipy.optimize import least_squares
from scipy.signal import lfilter

from mecazen_experiments.identify.data import Array, MotorLog
from mecazen_experiments.identify.models import ambiguities, covariance

MAX_DELAY_S = 0.2
LAGS_S = (0.01, 0.05, 0.2)
"""Time constants from which a fit may begin."""
NOISELESS_RAD_S = 1e-6
"""Deviation of speeds in data without noise."""
NAMES = (
    "delay_s",
    "time_constant_s",
    "dead_band_rad_s",
    *(f"gain of {wheel}" for wheel in WHEELS),
)


def response(values: Array, log: MotorLog) -> tuple[Array, Array]:
    """Return the wheels' speeds at the end of each interval, and their means during it (n, 4).

    Args:
        values: The parameters `NAMES`.
        log: The commands.
    """
    delay, lag, dead = values[:3]
    period, lag = log.period_s, max(lag, 1e-6)
    commands = np.sign(log.commands) * np.maximum(np.abs(log.commands) - dead, 0.0) * values[3:]
    whole = math.floor(delay / period)
    remainder = delay - whole * period
    first, then = (_late(commands, steps) for steps in (whole + 1, whole))
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

    Intervals are from the curvature.
    """

    def residuals(values: Array) -> Array:
        return np.concatenate([(response(values, log)[1] - log.speeds).ravel() for log in logs])

    starts = [
        np.array([delay, lag, 0.0, 1.0, 1.0, 1.0, 1.0])
        for delay in np.arange(0.0, MAX_DELAY_S, 2.0 * logs[0].period_s)
        for lag in LAGS_S
    ]
    start = min(starts, key=lambda values: float(np.square(residuals(values)).sum()))
    upper = np.array([2.0 * MAX_DELAY_S, 10.0, 100.0, *[10.0] * 4])
    solution = least_squares(
        residuals,
        np.clip(start, 1e-9, upper / 2.0),
        bounds=(np.zeros(len(NAMES)), upper),
        x_scale=np.array([0.01, 0.05, 0.1, 1.0, 1.0, 1.0, 1.0]),
        diff_step=1e-4,
    )
    deviation = max(math.sqrt(2.0 * solution.cost / len(solution.fun)), NOISELESS_RAD_S)
    spread = covariance(solution.jac / deviation)
    halves = (1.96 * np.sqrt(np.diag(spread))).tolist()
    result = {
        name: Interval(value, value - half, value + half, len(solution.fun))
        for name, value, half in zip(NAMES, solution.x.tolist(), halves, strict=True)
    }
    return result, ambiguities(NAMES, spread)


def identified_motors(motors: RealMotors, parameters: Mapping[str, Interval]) -> RealMotors:
    """Return motors with identified parameters; friction and sag remain."""
    values = [max(interval.mean, 0.0) for interval in parameters.values()]
    common = {name: round(value, 6) for name, value in zip(NAMES[:3], values, strict=False)}
    return msgspec.structs.replace(
        motors, gains=tuple(round(gain, 5) for gain in values[3:]), **common
    )
