"""The interacting multiple model (IMM) filter of a walking person."""

from __future__ import annotations

from functools import partial

from mecazen.schema import Positive

from mecazen_follower.estimators.ctrv import MIN_POSITION_WALK, TurnRateEstimator, TurnRateParams
from mecazen_follower.estimators.modes import Mode, ModeBank

NEARLY_ZERO = 0.02
"""Random walk [m/s² or rad/s²] of a speed or turn rate that a mode assumes to be 0."""


class ImmParams(TurnRateParams):
    """Parameters of `imm`: random walks and mean sojourn time of each mode."""

    sway_m_sqrt_m: Positive = 0.012
    standing_yaw_std_rad: Positive = 0.04
    """Random walk of the heading while standing."""
    standing_s: Positive = 3.0
    straight_acceleration_std_m_s2: Positive = 0.015
    straight_yaw_std_rad: Positive = 0.004
    """Random walk of the heading while walking straight."""
    straight_s: Positive = 25.0
    turning_acceleration_std_m_s2: Positive = 0.018
    turning_yaw_acceleration_std_rad_s2: Positive = 0.009
    turning_s: Positive = 15.0
    manoeuvre_step_m_sqrt_s: Positive = 0.09
    """Random walk of the position: people also step aside, which CTRV does not model."""
    manoeuvre_acceleration_std_m_s2: Positive = 1.4
    manoeuvre_yaw_acceleration_std_rad_s2: Positive = 1.3
    manoeuvre_s: Positive = 6.0


class ImmFilter(TurnRateEstimator, name="imm", params=ImmParams):
    """An IMM of four modes: standing, walking straight, turning steadily, and manoeuvring.

    Manoeuvring is setting off, stopping and turning quickly; it takes over within a few frames.
    The other modes average over seconds.
    """

    def __init__(self, params: ImmParams) -> None:
        super().__init__(params)
        p, sway = params, params.sway_m_sqrt_m
        steady = sway, MIN_POSITION_WALK
        turning = p.turning_acceleration_std_m_s2, p.turning_yaw_acceleration_std_rad_s2
        manoeuvre = p.manoeuvre_acceleration_std_m_s2, p.manoeuvre_yaw_acceleration_std_rad_s2
        standing = *steady, p.standing_yaw_std_rad, NEARLY_ZERO, NEARLY_ZERO
        straight = *steady, p.straight_yaw_std_rad, p.straight_acceleration_std_m_s2, NEARLY_ZERO
        modes = (
            Mode(standing, moves=False, turns=False, mean_sojourn=p.standing_s),
            Mode(straight, turns=False, mean_sojourn=p.straight_s),
            Mode((*steady, 0.0, *turning), mean_sojourn=p.turning_s),
            Mode((sway, p.manoeuvre_step_m_sqrt_s, 0.0, *manoeuvre), mean_sojourn=p.manoeuvre_s),
        )
        self._begin = partial(ModeBank, modes)
