"""Estimators of the person's pose and velocity in odom, from noisy observations.

To add one: subclass `Estimator` with a name, by which scenarios select it.
"""

# imported, each registers itself
from mecazen_follower.estimators import ctrv, imm, linear  # noqa: F401
from mecazen_follower.estimators.base import Array, Estimate, Estimator, make_estimator

ESTIMATORS = Estimator.registry
"""Every estimator, by its name in a scenario."""

__all__ = ["ESTIMATORS", "Array", "Estimate", "Estimator", "make_estimator"]
