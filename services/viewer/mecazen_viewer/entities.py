"""Names and colours of what is shown: the scene and the layout both go by them."""

from __future__ import annotations

import rerun as rr

from mecazen_viewer.components import Components

Entity = tuple[str, rr.AsComponents | Components]
"""A path in the recording, and what is logged there."""

TIMELINE = "sim_time"

WORLD = "world"
FOLLOW = "world/follow"
"""A frame that moves with the robot and does not turn: that of the large view."""
GROUND = "world/ground"
ROBOT = "world/robot"
PERSON = "world/person"
OBSTACLES = "world/obstacles"
OBSERVATION = "world/observation"
OBSERVATION_ELLIPSE = "world/observation_covariance"
ODOM = "world/odom"
"""The odometry's frame, laid so that the robot in it is where it truly is."""
ESTIMATE = "world/odom/estimate"
ESTIMATE_ELLIPSE = "world/odom/estimate_covariance"
GOAL = "world/odom/goal"
TRAILS = "world/trails"

DISTANCE = "plots/distance"
ANGLE = "plots/angle"
VELOCITY = "plots/velocity"
YAW_RATE = "plots/yaw_rate"
WHEEL_SPEED = "plots/wheel_speed"
NEES = "plots/nees"
REAL_TIME = "plots/real_time"

LOG = "log"
HEALTH = "health"

Colour = tuple[int, int, int]

# by Okabe and Ito, safe for the colour-blind, and readable on dark and on light
BLUE: Colour = (0, 114, 178)
ORANGE: Colour = (230, 159, 0)
GREEN: Colour = (0, 158, 115)
PURPLE: Colour = (190, 90, 160)
SKY: Colour = (86, 180, 233)
RED: Colour = (213, 40, 30)
GREY: Colour = (128, 128, 128)


def of_robot(path: str, robot: str) -> str:
    """Return where something of one of several robots is: below its name, in its branch.

    A whole branch, as the table of health is, belongs to all.
    """
    branch, slash, rest = path.partition("/")
    return f"{branch}/{robot}/{rest}" if robot and slash else path
