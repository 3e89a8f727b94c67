"""Estimators of the person's pose and velocity in odom, from noisy observations.

To add an estimator, subclass `Estimator` with a name. Scenarios select it by this name.
"""

# each module registers its estimators when it is imported
from mecazen_follower.estimators import imm, kf  # noqa: F401
from mecazen_follower.estimators.base import Array, Estimate, Estimator, make_estimator

ESTIMATORS = Estimator.registry
"""Every estimator, by its name in a scenario."""

__all__ = ["ESTIMATORS", "Array", "Estimate", "Estimator", "make_estimator"]
