"""Estimators of the person's pose and velocity in odom, from noisy observations.

To add one: subclass `Estimator` with a name, by which scenarios select it.
"""

from mecazen_follower.estimators.base import (
    MAX_DISTANCE,
    Array,
    Estimate,
    Estimator,
    Params,
    make_params,
)
from mecazen_follower.estimators.constant_velocity import ConstantVelocityFilter
from mecazen_follower.estimators.ctrv import ExtendedFilter, UnscentedFilter
from mecazen_follower.estimators.displacement import DisplacementFilter
from mecazen_follower.estimators.imm import ImmFilter
from mecazen_follower.estimators.raw import RawObservation

ESTIMATORS = Estimator.registry
"""Every estimator, by its name in a scenario."""

__all__ = [
    "ESTIMATORS",
    "MAX_DISTANCE",
    "Array",
    "ConstantVelocityFilter",
    "DisplacementFilter",
    "Estimate",
    "Estimator",
    "ExtendedFilter",
    "ImmFilter",
    "Params",
    "RawObservation",
    "UnscentedFilter",
    "make_params",
]
