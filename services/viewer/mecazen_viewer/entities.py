"""Entity paths and colours, shared by the scene and the layout."""

from __future__ import annotations

import rerun as rr

from mecazen_viewer.components import Components

Entity = tuple[str, rr.AsComponents | Components]
"""A path in the recording and the data to log there."""

TIMELINE = "sim_time"

WORLD = "world"
FOLLOW = "world/follow"
"""The frame of the large view: it moves with the robot and does not rotate."""
GROUND = "world/ground"
ROBOT = "world/robot"
PERSON = "world/person"
OBSTACLES = "world/obstacles"
RIDGES = "world/ridges"
PATCHES = "world/patches"
OBSERVATION = "world/observation"
OBSERVATION_ELLIPSE = "world/observation_covariance"
ODOM = "world/odom"
"""The odom frame, placed so that odometry and ground truth of the robot coincide."""
ESTIMATE = "world/odom/estimate"
ESTIMATE_ELLIPSE = "world/odom/estimate_covariance"
GOAL = "world/odom/goal"
TRAILS = "world/trails"
BODY = "world/body"
"""The person's true limbs."""
PEOPLE = "world/people"
"""The bones of people whom no robot follows."""
SKELETON = "world/skeleton"
"""The bones that the body tracker sees."""
SCAN = "world/scan"
FRUSTUM = "world/robot/camera_view"
DEPTH = "camera/depth"

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

# after Okabe and Ito: safe for the colour-blind, readable on dark and light backgrounds
BLUE: Colour = (0, 114, 178)
ORANGE: Colour = (230, 159, 0)
GREEN: Colour = (0, 158, 115)
PURPLE: Colour = (190, 90, 160)
SKY: Colour = (86, 180, 233)
RED: Colour = (213, 40, 30)
GREY: Colour = (128, 128, 128)


def of_robot(path: str, robot: str) -> str:
    """Return a path in the namespace of one of several robots, whose name follows the first part.

    A path of one part, such as the table of health, belongs to all robots.
    """
    branch, slash, rest = path.partition("/")
    return f"{branch}/{robot}/{rest}" if robot and slash else path
