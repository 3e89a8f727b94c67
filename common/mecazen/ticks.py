"""Rates and times of a scenario in ticks."""

from __future__ import annotations

import math

from mecazen.errors import ConfigError

ROUNDING_S = 1e-9
"""Tolerance for times, which are sums of ticks: a sum may differ from a limit in the last bit."""


def ticks_per_sample(key: str, rate_hz: float, tick_s: float) -> int:
    """Return the ticks from one sample to the next at a rate.

    Raises:
        ConfigError: The rate does not divide the tick rate; the message names `key`.
    """
    ratio = 1.0 / (tick_s * rate_hz)
    ticks = round(ratio)
    if ticks < 1 or not math.isclose(ticks, ratio, rel_tol=1e-6):
        slower, faster = (1.0 / (tick_s * max(1, math.floor(ratio) + n)) for n in (1, 0))
        raise ConfigError(
            f"{key} = {rate_hz:g} must divide the tick rate of {1.0 / tick_s:g} Hz, as "
            f"{slower:.6g} and {faster:.6g} do"
        )
    return ticks


def whole_ticks(key: str, seconds: float, tick_s: float) -> int:
    """Return `seconds` in ticks.

    Raises:
        ConfigError: The time is not a whole number of ticks; the message names `key`.
    """
    ticks = round(seconds / tick_s) if math.isfinite(seconds) else 0
    is_whole = abs(ticks * tick_s - seconds) <= 1e-9 * max(1.0, ticks * tick_s)
    if not is_whole or (seconds > 0 and ticks == 0):
        raise ConfigError(f"{key}: {seconds:.9g} s is not a whole number of ticks of {tick_s} s")
    return ticks
