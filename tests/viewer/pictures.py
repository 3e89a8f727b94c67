"""A picture of one robot, its messages, and its entities."""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from harness import load_robot
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.geometry import Pose2D, Twist2D
from mecazen_viewer.components import Components
from mecazen_viewer.entities import Entity
from mecazen_viewer.health import Health
from mecazen_viewer.picture import Picture
from viewer_stage import COVARIANCE, values


def picture() -> Picture:
    return Picture(Scenario(robot=load_robot()), Health())


def odometry(pose: Pose2D) -> m.Odometry:
    return m.planar_odometry(m.Time(), "world", "base_link", pose, Twist2D())


def scalars(entities: Mapping[str, Components], path: str) -> np.ndarray:
    """The newest values of a plot."""
    return values(entities, path, "Scalars:scalars")


def place(entities: Iterable[Entity], path: str) -> Pose2D:
    """The planar pose of a frame."""
    logged = dict(entities)
    x, y, _ = values(logged, path, "Transform3D:translation")[0]
    _, _, z, w = values(logged, path, "Transform3D:quaternion")[0]
    return Pose2D(x, y, 2.0 * math.atan2(z, w))


def following(estimate: Pose2D, goal: Pose2D, tracking: str = "following") -> m.FollowerState:
    pose = m.PoseWithCovariance(pose=m.Pose.planar(estimate), covariance=COVARIANCE)
    return m.FollowerState(
        tracking=tracking,
        estimate=(m.Odometry(pose=pose),),
        goal=(m.Pose.planar(goal),),
        distance_error=0.25,
        heading_error=0.5,
    )


def physics_says(rtf: str, level: int = 0, message: str = "ok") -> m.DiagnosticArray:
    status = m.DiagnosticStatus(
        level=level, name="physics", message=message, values=(m.KeyValue(key="rtf", value=rtf),)
    )
    return m.DiagnosticArray(status=(status,))
