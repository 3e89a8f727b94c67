"""The interacting multiple model (IMM) filter of a walking person."""

from __future__ import annotations

import math

from mecazen.config.follower import ImmParams

from mecazen_follower.estimators.base import Array
from mecazen_follower.estimators.ctrv import MIN_POSITION_WALK, TurnRateEstimator
from mecazen_follower.estimators.modes import Mode, ModeBank
from mecazen_follower.estimators.turn_rate import YAW

NEARLY_ZERO = 0.02
"""Random walk [m/s² or rad/s²] of a speed or turn rate that a mode assumes to be 0."""

SHARP_DEG, BLUNT_DEG = 5.0, 65.0
"""Standard deviations of an observed heading: `AT_BLUNT` applies at `BLUNT_DEG`."""
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


DEFAULTS = ImmParams()


def at_noise(params: ImmParams, yaw_std_deg: float) -> dict[str, float]:
    """Return parameters for a sensor with this standard deviation of the heading.

    Modes can be distinguished only over a time in which the noise averages out, so a noisy sensor
    needs modes that last longer and are disturbed less. Each parameter is scaled by the factor that
    takes its default to the value in `AT_BLUNT` at 65 degrees. The factor is 1 at 5 degrees and a
    power of the standard deviation in between.
    """
    whole = math.log(BLUNT_DEG / SHARP_DEG)
    share = min(max(math.log(yaw_std_deg / SHARP_DEG) / whole, 0.0), 1.0)
    return {
        name: getattr(params, name)
        * (AT_BLUNT[name] / getattr(DEFAULTS, name) if name in AT_BLUNT else 1.0) ** share
        for name in ImmParams.__struct_fields__
    }


class ImmFilter(TurnRateEstimator, name="imm"):
    """An IMM of five modes: standing, straight, turning steadily, wandering, manoeuvring.

    The manoeuvring mode covers setting off, stopping and quick turns; it takes over within a few
    frames. The wandering mode is how real people walk. The other modes average over seconds. The
    averaging times are set by the sensor's noise.
    """

    def __init__(self, params: ImmParams) -> None:
        super().__init__(params)
        self._params = params

    def _begin(self, state: Array, covariance: Array) -> ModeBank:
        """Return a filter that starts with the first observation and is tuned to its noise."""
        yaw_std_deg = math.degrees(math.sqrt(covariance[YAW, YAW]))
        modes = modes_of(ImmParams(**at_noise(self._params, yaw_std_deg)))
        return ModeBank(modes, state, covariance)


def modes_of(p: ImmParams) -> tuple[Mode, ...]:
    """Return the modes with these parameters, without scaling by the noise."""
    steady = p.sway_m_sqrt_m, MIN_POSITION_WALK
    standing = *steady, p.standing_yaw_std_rad, NEARLY_ZERO, NEARLY_ZERO
    straight = *steady, p.straight_yaw_std_rad, p.straight_acceleration_std_m_s2, NEARLY_ZERO
    turning = p.turning_acceleration_std_m_s2, p.turning_yaw_acceleration_std_rad_s2
    wandering = p.wandering_acceleration_std_m_s2, p.wandering_yaw_acceleration_std_rad_s2
    manoeuvre = p.manoeuvre_acceleration_std_m_s2, p.manoeuvre_yaw_acceleration_std_rad_s2
    return (
        Mode(standing, moves=False, turns=False, mean_sojourn=p.standing_s),
        Mode(straight, turns=False, mean_sojourn=p.straight_s),
        Mode((*steady, 0.0, *turning), mean_sojourn=p.turning_s),
        Mode(
            (*steady, 0.0, *wandering),
            mean_sojourn=p.wandering_s,
            fading=p.wandering_fading_1_s,
        ),
        Mode(
            (p.sway_m_sqrt_m, p.manoeuvre_step_m_sqrt_s, 0.0, *manoeuvre),
            mean_sojourn=p.manoeuvre_s,
            fading=p.manoeuvre_fading_1_s,
        ),
    )
