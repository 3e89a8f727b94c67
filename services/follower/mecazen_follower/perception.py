"""Perception: from the joints of a body, or a lidar scan, to observations of persons."""

from __future__ import annotations

import math

import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen.keys import LEGS, OBSERVATION, SCAN, SKELETONS
from mecazen.messages import PlanarCovariance, Skeleton, ros_covariance
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.scan import BOTH_LEGS_M, LEG_M, Clusters, by_person, clusters, ranges_of
from mecazen.skeleton import INDEX
from mecazen.walkers import PAIR_STD_M, SINGLE_STD_M

from mecazen_follower.measurement import NO_HEADING

_TRUNK = tuple(INDEX[name] for name in ("pelvis", "spine", "neck"))
_LINES = tuple((INDEX[f"left_{joint}"], INDEX[f"right_{joint}"]) for joint in ("hip", "shoulder"))
"""Joints that lie across the direction in which the person faces."""

SWAY_STD_M = 0.015
"""Sway of a trunk about the person's path: M. S. Orendurff et al., J. Rehabil. Res. Dev. 41, 2004,
4 to 7 cm from side to side."""
TWIST_STD_RAD = math.radians(4.0)
"""Twist of pelvis and shoulders about the walking direction: once a stride, in opposition."""
LEAST_STD_M = 1e-4
"""Minimum standard deviation: a tracker that reports no error still has its resolution [m]."""
PLACE_CORRELATED, HEADING_CORRELATED = 25.0, 25.0
"""Factors on the variances of one frame: most of a tracker's error persists for many frames, but
the filter assumes independent errors. The factors were tuned by the NEES of the U-track."""


Detection = tuple[Pose2D, PlanarCovariance]
"""The pose of a person in the frame of a sensor, and its covariance."""


def pose_of(body: Skeleton) -> Detection | None:
    """Return a person in the frame of a skeleton.

    The trunk's joints are above each other, at the person's position. The lines through hips and
    shoulders are at right angles to the heading; each line is weighted by its inverse variance.
    Without a line the heading's variance is `NO_HEADING`.

    Returns:
        None if no joint of the trunk is in view.
    """
    joints = [joint for joint in _TRUNK if body.confidence[joint]]
    if not joints:
        return None
    weights = [1.0 / max(body.std[joint], LEAST_STD_M) ** 2 for joint in joints]
    total = math.fsum(weights)
    x = (
        math.fsum(w * body.joints[joint].x for w, joint in zip(weights, joints, strict=True))
        / total
    )
    y = (
        math.fsum(w * body.joints[joint].y for w, joint in zip(weights, joints, strict=True))
        / total
    )
    variance = PLACE_CORRELATED / total + SWAY_STD_M**2
    yaw, yaw_variance = _heading(body)
    return Pose2D(x, y, yaw), ((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, yaw_variance))


def _heading(body: Skeleton) -> tuple[float, float]:
    """Return the heading [rad] and its variance [rad²]."""
    ahead = left = total = 0.0
    for left_joint, right_joint in _LINES:
        if not (body.confidence[left_joint] and body.confidence[right_joint]):
            continue
        dx = body.joints[left_joint].x - body.joints[right_joint].x
        dy = body.joints[left_joint].y - body.joints[right_joint].y
        length = math.hypot(dx, dy)
        across = body.std[left_joint] ** 2 + body.std[right_joint] ** 2
        if length * length <= across:
            continue  # too short for a direction
        weight = 1.0 / (HEADING_CORRELATED * across / length**2 + TWIST_STD_RAD**2)
        ahead, left = ahead + weight * dy / length, left - weight * dx / length
        total += weight
    if total == 0.0:
        return 0.0, NO_HEADING
    return math.atan2(left, ahead), 1.0 / total


GAP_M = 0.13
"""Neighbouring points that are farther apart belong to different objects; as in K. O. Arras et al.,
Using boosted features for the detection of people in 2D range data, ICRA 2007."""
LEAST_POINTS, LEAST_M = 3, 0.03
"""Minimum number of points on a leg, and its minimum width [m]."""
DEPTH_M = 0.035
"""Distance from the mean of the points on a shank to its axis [m]."""


def persons(clusters: Clusters) -> list[Detection]:
    """Return possible persons in the lidar's frame.

    Everything as wide as a leg is taken for a leg. The tracker identifies the person by motion.
    The heading is unknown: its variance is `NO_HEADING`.
    """
    away = np.sqrt(np.sum(clusters.middle**2, axis=-1))
    centres = (clusters.middle * (1.0 + DEPTH_M / np.maximum(away, DEPTH_M))[:, None]).tolist()
    good = (clusters.counts >= LEAST_POINTS) & (clusters.width >= LEAST_M)
    legs = good & (clusters.width <= LEG_M)
    both = good & (clusters.width > LEG_M) & (clusters.width <= BOTH_LEGS_M)
    detections: list[Detection] = []
    for members, (x, y) in by_person(centres, legs, both):
        is_single = len(members) == 1 and legs[members[0]]
        variance = (SINGLE_STD_M if is_single else PAIR_STD_M) ** 2
        covariance = (variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, NO_HEADING)
        detections.append((Pose2D(x, y), covariance))
    return detections


class BodyNode(Node):
    """Finds position and heading of persons from the visible joints."""

    def reset(self, seed: int) -> None:
        """Do nothing: frames are independent."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return all persons whose trunk is in view."""
        del tick
        frame = inputs[SKELETONS]
        seen = ((body.id, pose_of(body)) for body in frame.skeletons)
        persons = [(identity, _message(*pose)) for identity, pose in seen if pose is not None]
        observation = m.Observation(
            header=frame.header,
            poses=tuple(pose for _, pose in persons),
            ids=tuple(identity for identity, _ in persons),
            reason=frame.reason,
        )
        return {OBSERVATION: observation}


class LegsNode(Node):
    """Finds persons by their legs in a scan."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        assert scenario.robot.lidar is not None
        self.lidar = scenario.robot.lidar.pose

    def reset(self, seed: int) -> None:
        """Do nothing: scans are independent."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return poses of possible persons in base_link."""
        del tick
        scan = inputs[SCAN]
        ranges = ranges_of(scan, is_real=self.scenario.has_real_lidar)
        detections = persons(clusters(scan, ranges, GAP_M))
        poses = [_message(self.lidar.compose(pose), covariance) for pose, covariance in detections]
        header = m.Header(stamp=scan.header.stamp, frame_id="base_link")
        return {LEGS: m.Observation(header=header, poses=tuple(poses))}


def _message(pose: Pose2D, covariance: PlanarCovariance) -> m.PoseWithCovariance:
    return m.PoseWithCovariance(pose=m.Pose.planar(pose), covariance=ros_covariance(covariance))
