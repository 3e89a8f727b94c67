"""The interacting multiple model (IMM) filter of a walking person."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mecazen.config.follower import ImmParams

from mecazen_follower.estimators.base import Array
from mecazen_follower.estimators.ctrv import MIN_POSITION_WALK, TurnRateEstimator
from mecazen_follower.estimators.modes import Mode, ModeBank
from mecazen_follower.estimators.turn_rate import YAW

NEARLY_ZERO = 0.02
"""Random walk [m/s² or rad/s²] of a speed or turn rate that a mode assumes to be 0."""

SHARP_DEG, BLUNT_DEG = 5.0, 65.0
"""Standard deviations of an observed heading, to which `AT_SHARP` and `AT_BLUNT` apply."""
AT_SHARP = {
    "standing_yaw_std_rad": 0.04,
    "standing_s": 1.7,
    "straight_acceleration_std_m_s2": 0.1,
    "straight_yaw_std_rad": 0.127,
    "straight_s": 6.0,
    "turning_acceleration_std_m_s2": 0.018,
    "turning_yaw_acceleration_std_rad_s2": 0.009,
    "turning_s": 15.0,
    "wandering_acceleration_std_m_s2": 0.29,
    "wandering_yaw_acceleration_std_rad_s2": 2.55,
    "wandering_s": 2.0,
    "wandering_fading_1_s": 4.8,
    "manoeuvre_step_m_sqrt_s": 0.13,
    "manoeuvre_acceleration_std_m_s2": 0.62,
    "manoeuvre_yaw_acceleration_std_rad_s2": 5.0,
    "manoeuvre_s": 0.4,
    "manoeuvre_fading_1_s": 1.7,
}
"""Random walks, mean sojourn time [s] and fading turn rate [1/s] of the modes, at `SHARP_DEG`.

A random walk is given by its standard deviation after 1 s: of the heading while standing and
walking straight, of the speed, of the turn rate, and of the position while people step aside, which
CTRV does not model. A turn fades by itself, since people who walk swing about their direction.
Straight, wandering and manoeuvring are fitted to recorded people: docs/results.md.
"""
AT_BLUNT = {
    "standing_s": 3.0,
    "straight_acceleration_std_m_s2": 0.015,
    "straight_yaw_std_rad": 0.004,
    "straight_s": 25.0,
    "wandering_acceleration_std_m_s2": 0.018,
    "wandering_yaw_acceleration_std_rad_s2": 0.009,
    "wandering_s": 15.0,
    "wandering_fading_1_s": 0.03,
    "manoeuvre_step_m_sqrt_s": 0.09,
    "manoeuvre_acceleration_std_m_s2": 1.4,
    "manoeuvre_yaw_acceleration_std_rad_s2": 1.3,
    "manoeuvre_s": 6.0,
    "manoeuvre_fading_1_s": 0.02,
}
"""The parameters for a sensor that hardly sees the heading, found on the U-track."""


def at_noise(yaw_std_deg: float) -> dict[str, float]:
    """Return the parameters of the modes for a standard deviation of the heading.

    Modes can be distinguished only over a time in which the noise averages out, so a noisy sensor
    needs modes that last longer and are disturbed less. A parameter is that of `AT_SHARP` up to 5
    degrees, that of `AT_BLUNT` from 65 degrees on, and in between a power of the deviation.
    """
    whole = math.log(BLUNT_DEG / SHARP_DEG)
    share = min(max(math.log(yaw_std_deg / SHARP_DEG) / whole, 0.0), 1.0)
    return {
        name: value * (AT_BLUNT.get(name, value) / value) ** share
        for name, value in AT_SHARP.items()
    }


class ImmFilter(TurnRateEstimator, name="imm"):
    """An IMM of five modes: standing, straight, turning steadily, wandering, manoeuvring.

    The manoeuvring mode covers setting off, stopping and quick turns; it takes over within a few
    frames. The wandering mode is how real people walk. The other modes average over seconds. The
    averaging times are set by the sensor's noise.
    """

    def __init__(self, params: ImmParams) -> None:
        super().__init__(params)
        self._sway = params.sway_m_sqrt_m

    def _begin(self, state: Array, covariance: Array) -> ModeBank:
        """Return a filter that starts with the first observation and is tuned to its noise."""
        yaw_std_deg = math.degrees(math.sqrt(covariance[YAW, YAW]))
        return ModeBank(modes_of(self._sway, at_noise(yaw_std_deg)), state, covariance)


def modes_of(sway: float, p: Mapping[str, float]) -> tuple[Mode, ...]:
    """Return the modes with these parameters and a sway [m/√m]."""
    steady = sway, MIN_POSITION_WALK
    standing = *steady, p["standing_yaw_std_rad"], NEARLY_ZERO, NEARLY_ZERO
    straight = *steady, p["straight_yaw_std_rad"], p["straight_acceleration_std_m_s2"], NEARLY_ZERO
    turning, wandering, manoeuvre = (
        (p[f"{mode}_acceleration_std_m_s2"], p[f"{mode}_yaw_acceleration_std_rad_s2"])
        for mode in ("turning", "wandering", "manoeuvre")
    )
    return (
        Mode(standing, moves=False, turns=False, mean_sojourn=p["standing_s"]),
        Mode(straight, turns=False, mean_sojourn=p["straight_s"]),
        Mode((*steady, 0.0, *turning), mean_sojourn=p["turning_s"]),
        Mode(
            (*steady, 0.0, *wandering),
            mean_sojourn=p["wandering_s"],
            fading=p["wandering_fading_1_s"],
        ),
        Mode(
            (sway, p["manoeuvre_step_m_sqrt_s"], 0.0, *manoeuvre),
            mean_sojourn=p["manoeuvre_s"],
            fading=p["manoeuvre_fading_1_s"],
        ),
    )
