"""The unfiltered observation."""

from __future__ import annotations

from mecazen.geometry import Pose2D, Twist2D

from mecazen_follower.estimators.base import Array, Estimate, Estimator
from mecazen_follower.estimators.kalman import as_tuple


class RawObservation(Estimator, name="none"):
    """The last observation, held until the next one, with zero velocity."""

    _estimate: Estimate | None = None

    def predict(self, dt: float) -> None:
        """Hold the last observation."""

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        self._estimate = Estimate(observation, Twist2D(), as_tuple(noise))

    @property
    def estimate(self) -> Estimate | None:
        """The last observation."""
        return self._estimate

    def reset(self) -> None:
        """Discard the last observation."""
        self._estimate = None
