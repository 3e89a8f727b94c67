"""The follower's section of a scenario."""

from __future__ import annotations

import math
from typing import Literal

import msgspec
from mecazen.schema import AngleDeg, Positive, Section

from mecazen_follower.control import PoseController
from mecazen_follower.estimators import ESTIMATORS, Estimator, make_params
from mecazen_follower.goal import VIEWS, Standoff
from mecazen_follower.pid import Gains
from mecazen_follower.tracking import Tracker


class AxisGains(Section):
    """The PIDs of the three axes of base_link.

    The robot answers to velocities, so the error decays with 1/kp already and a derivative
    only slows it: it is for a robot whose wheels lag behind.
    """

    x: Gains = Gains(kp=1.5, ki=0.1, limit=2.0)
    y: Gains = Gains(kp=1.5, ki=0.1, limit=2.0)
    yaw: Gains = Gains(kp=2.0, ki=0.1, limit=2.5)


class FollowerConfig(Section):
    """The follower: where to stand, how to estimate, how to drive.

    The place is a named `view`, or any other by `bearing_deg` and `heading_deg` together,
    which then take the view's place.
    """

    view: Literal["back", "side_left", "side_right", "front"] = "back"
    bearing_deg: AngleDeg | None = None
    """Direction from the person to the robot: 0 is ahead of the person, 90 to the left."""
    heading_deg: AngleDeg | None = None
    """The robot's heading less the person's."""
    standoff_m: Positive = 1.0
    """Distance from the person to the robot."""
    estimator: str = "kf_cv"
    estimator_params: dict[str, float] = msgspec.field(default_factory=dict)
    """Parameters of the estimator by name; those not given are filled in."""
    gains: AxisGains = AxisGains()
    feed_forward: bool = True
    """Add the estimated velocity of the goal to the command."""
    coast_after_s: Positive = 0.1
    """Unseen for longer than this, the person is no longer followed but predicted."""
    lost_after_s: Positive = 2.0
    """Unseen for longer than this, the person is lost and the robot comes to rest."""

    def __post_init__(self) -> None:
        if (self.bearing_deg is None) != (self.heading_deg is None):
            raise ValueError("bearing_deg and heading_deg must be given together")
        if self.lost_after_s <= self.coast_after_s:
            raise ValueError(
                f"lost_after_s = {self.lost_after_s:g} must be above "
                f"coast_after_s = {self.coast_after_s:g}"
            )
        params = make_params(self.estimator, self.estimator_params)
        # Frozen, but not yet seen by anyone.
        msgspec.structs.force_setattr(self, "estimator_params", msgspec.to_builtins(params))

    @property
    def standoff(self) -> Standoff:
        """The place to keep, in radians."""
        bearing, heading = VIEWS[self.view]
        if self.bearing_deg is not None and self.heading_deg is not None:
            bearing, heading = self.bearing_deg, self.heading_deg
        return Standoff(self.standoff_m, math.radians(bearing), math.radians(heading))

    def make_estimator(self) -> Estimator:
        """Return a new estimator."""
        params = make_params(self.estimator, self.estimator_params)
        return ESTIMATORS[self.estimator](params)

    def make_controller(self) -> PoseController:
        """Return a new controller."""
        return PoseController(self.gains.x, self.gains.y, self.gains.yaw, self.feed_forward)

    def make_tracker(self) -> Tracker:
        """Return a new tracker."""
        return Tracker(self.coast_after_s, self.lost_after_s)
