"""`[follower.estimator_params]`: the parameters of each estimator of the person's motion."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mecazen.schema import NonNegative, Positive, Section


class Params(Section):
    """Parameters of every estimator: the noise assumed for a sensor that reports none."""

    position_std_m: Positive = 0.05
    yaw_std_deg: Positive = 5.0


class ConstantVelocityParams(Params):
    """Parameters of `kf_cv`.

    The accelerations are white noise. Each is given by the square root of its spectral density:
    the standard deviation of its mean over 1 s, which does not depend on the tick.
    """

    acceleration_std_m_s2: Positive = 0.2
    yaw_acceleration_std_rad_s2: Positive = 0.15
    initial_speed_std_m_s: Positive = 1.0
    """Prior of each component, since the first observation has no velocity."""
    initial_yaw_rate_std_rad_s: Positive = 0.5


class DisplacementParams(Params):
    """Parameters of `kf_displacement`."""

    position_drift_m_sqrt_s: Positive = 0.1
    """Random walk of the position: its standard deviation after 1 s."""
    smoothing_s: Positive = 1.0
    """Time constant of the exponential smoothing of the displacement."""
    min_speed_m_s: NonNegative = 0.08
    """Below this speed the heading is not taken from the displacement."""


class TurnRateParams(Params):
    """Parameters of all filters of constant turn rate and velocity.

    A random walk is given by its standard deviation after 1 s.
    """

    sway_m_sqrt_m: Positive = 0.03
    """Isotropic random walk of the position: its standard deviation after 1 m walked."""
    initial_speed_std_m_s: Positive = 1.0
    """Prior, since the first observation has no velocity."""
    initial_yaw_rate_std_rad_s: Positive = 0.5
    noise_memory_s: NonNegative = 0.0
    """Time constant of learning the sensor's noise; at 0 the reported noise is used."""


class CtrvParams(TurnRateParams):
    """Parameters of `ekf_ctrv`."""

    acceleration_std_m_s2: Positive = 0.3
    """Random walk of the speed."""
    yaw_acceleration_std_rad_s2: Positive = 0.3
    """Random walk of the turn rate."""


class ImmParams(TurnRateParams):
    """Parameters of `imm`: random walks, mean sojourn time and fading turn rate of each mode.

    The values hold for an observed heading with a standard deviation of 5 degrees; the filter
    adapts them to other sensors. Straight, wandering and manoeuvring are fitted to recorded people:
    docs/results.md.
    """

    sway_m_sqrt_m: Positive = 0.012
    standing_yaw_std_rad: Positive = 0.04
    """Random walk of the heading while standing."""
    standing_s: Positive = 1.7
    straight_acceleration_std_m_s2: Positive = 0.1
    straight_yaw_std_rad: Positive = 0.127
    """Random walk of the heading while walking straight."""
    straight_s: Positive = 6.0
    turning_acceleration_std_m_s2: Positive = 0.018
    turning_yaw_acceleration_std_rad_s2: Positive = 0.009
    turning_s: Positive = 15.0
    wandering_acceleration_std_m_s2: Positive = 0.29
    wandering_yaw_acceleration_std_rad_s2: Positive = 2.55
    wandering_s: Positive = 2.0
    wandering_fading_1_s: NonNegative = 4.8
    """Rate at which a turn ends by itself: people who walk swing about their direction."""
    manoeuvre_step_m_sqrt_s: Positive = 0.13
    """Random walk of the position: people also step aside, which CTRV does not model."""
    manoeuvre_acceleration_std_m_s2: Positive = 0.62
    manoeuvre_yaw_acceleration_std_rad_s2: Positive = 5.0
    manoeuvre_s: Positive = 0.4
    manoeuvre_fading_1_s: NonNegative = 1.7


PARAMS: dict[str, type[Params]] = {
    "none": Params,
    "kf_cv": ConstantVelocityParams,
    "kf_displacement": DisplacementParams,
    "ekf_ctrv": CtrvParams,
    "imm": ImmParams,
}
"""The parameters of each estimator by its name; an estimator of a user program adds its own."""


def make_params(name: str, params: Mapping[str, float]) -> Params:
    """Return the parameters of the estimator `name`: those given, else their defaults.

    Raises:
        ValueError: The name or a parameter is unknown.
    """
    if name not in PARAMS:
        raise ValueError(f"unknown estimator {name!r}, allowed: {', '.join(sorted(PARAMS))}")
    kind = PARAMS[name]
    unknown = params.keys() - set(kind.__struct_fields__)
    if unknown:
        raise ValueError(
            f"{name} has no parameter {', '.join(sorted(unknown))}, "
            f"allowed: {', '.join(kind.__struct_fields__)}"
        )
    return msgspec.convert(params, kind)
