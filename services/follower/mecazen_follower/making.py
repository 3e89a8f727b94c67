"""The control law and the planner that a configuration selects."""

from __future__ import annotations

from mecazen.config import FollowerConfig
from mecazen.config.follower import PidControl, PolarControl
from mecazen.drive import Drive

from mecazen_follower.pid import PoseController
from mecazen_follower.planner.costs import Extents, Sight
from mecazen_follower.planner.law import PolarGains
from mecazen_follower.planner.planner import Planner
from mecazen_follower.polar import ALL_AROUND, UNLIMITED, Approach, FieldOfView, PolarController


def make_planner(
    config: FollowerConfig, drive: Drive, body: Extents, sight: Sight, seed: int
) -> Planner | None:
    """Return a new planner for such a robot, if one is configured."""
    if config.planner is None:
        return None
    law = config.control if isinstance(config.control, PolarControl) else PolarControl()
    gains = PolarGains(
        law.linear_gain_1_s,
        law.linear_braking_m_s2,
        law.heading_gain_1_s,
        law.heading_braking_rad_s2,
        law.max_yaw_rate_rad_s,
    )
    return Planner(
        config.planner, config.standoff, gains, drive, law.max_speed_m_s, body, sight, seed
    )


def make_controller(
    config: FollowerConfig, drive: Drive = UNLIMITED, view: FieldOfView = ALL_AROUND
) -> PoseController | PolarController:
    """Return a new controller for a robot with these limits; see `PolarController`."""
    law = config.control
    if isinstance(law, PidControl):
        return PoseController(law.x, law.y, law.yaw, law.feed_forward)
    linear = Approach(law.linear_gain_1_s, law.linear_braking_m_s2)
    heading = Approach(law.heading_gain_1_s, law.heading_braking_rad_s2)
    limits = law.max_speed_m_s, law.max_yaw_rate_rad_s
    return PolarController(config.standoff, linear, heading, *limits, drive, view)
