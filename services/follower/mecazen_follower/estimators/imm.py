"""Interacting multiple models of a walking person."""

from __future__ import annotations

from mecazen.schema import Positive

from mecazen_follower.estimators.base import Array
from mecazen_follower.estimators.ctrv import (
    STEADY,
    StateFilter,
    TurnRateEstimator,
    TurnRateParams,
)
from mecazen_follower.estimators.modes import Mode, ModeBank

ALL_BUT_0 = 0.02
"""Random walk [m/s² or rad/s²] of a speed or turn rate that a mode takes to be 0."""


class ImmParams(TurnRateParams):
    """Parameters of `imm`: of each mode its random walks, and how long it lasts on average."""

    sway_m_sqrt_m: Positive = 0.012
    standing_yaw_std_rad: Positive = 0.04
    """Of the heading of who stands."""
    standing_s: Positive = 3.0
    straight_acceleration_std_m_s2: Positive = 0.015
    straight_yaw_std_rad: Positive = 0.004
    """Of the heading of who walks straight."""
    straight_s: Positive = 25.0
    turning_acceleration_std_m_s2: Positive = 0.018
    turning_yaw_acceleration_std_rad_s2: Positive = 0.009
    turning_s: Positive = 15.0
    manoeuvre_step_m_sqrt_s: Positive = 0.09
    """Of the position: people also step aside, where the model walks along the heading."""
    manoeuvre_acceleration_std_m_s2: Positive = 1.4
    manoeuvre_yaw_acceleration_std_rad_s2: Positive = 1.3
    manoeuvre_s: Positive = 6.0


class ImmFilter(TurnRateEstimator, name="imm", params=ImmParams):
    """Four extended Kalman filters that interact, each for a way to move.

    Standing; walking straight; turning steadily; and manoeuvring, which is setting off,
    stopping and turning quickly. The steady ones average over seconds, so that the heading
    of who walks comes from where they go, however little the sensor knows of it; the last
    one takes over within a few frames.
    """

    def __init__(self, params: ImmParams) -> None:
        sway = params.sway_m_sqrt_m
        turning = params.turning_acceleration_std_m_s2, params.turning_yaw_acceleration_std_rad_s2
        manoeuvre = (
            params.manoeuvre_acceleration_std_m_s2,
            params.manoeuvre_yaw_acceleration_std_rad_s2,
        )
        straight = params.straight_yaw_std_rad, params.straight_acceleration_std_m_s2
        self._modes = (
            Mode(
                (sway, STEADY, params.standing_yaw_std_rad, ALL_BUT_0, ALL_BUT_0),
                moves=False,
                turns=False,
                lasts=params.standing_s,
            ),
            Mode((sway, STEADY, *straight, ALL_BUT_0), turns=False, lasts=params.straight_s),
            Mode((sway, STEADY, 0.0, *turning), lasts=params.turning_s),
            Mode((sway, params.manoeuvre_step_m_sqrt_s, 0.0, *manoeuvre), lasts=params.manoeuvre_s),
        )
        super().__init__(params)

    def _begin(self, state: Array, covariance: Array) -> StateFilter:
        return ModeBank(self._modes, state, covariance)
