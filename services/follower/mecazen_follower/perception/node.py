"""The nodes of perception: from sensor data to observations of persons."""

from __future__ import annotations

from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen.keys import LEGS, OBSERVATION, SCAN, SKELETONS
from mecazen.messages import ros_covariance
from mecazen.node import Inputs, Node, Outputs, Tick

from mecazen_follower.perception.body import pose_of
from mecazen_follower.perception.legs import clusters_of, persons


class Body(Node):
    """Finds position and heading of persons from the visible joints."""

    def reset(self, seed: int) -> None:
        """Do nothing: frames are independent."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return all persons whose trunk is in view."""
        del tick
        frame = inputs[SKELETONS]
        seen = ((pose_of(body), body.id) for body in frame.skeletons)
        found = [(*pose, identity) for pose, identity in seen if pose is not None]
        return {
            OBSERVATION: m.Observation(
                header=frame.header,
                poses=tuple(
                    m.PoseWithCovariance(
                        pose=m.Pose.planar(pose), covariance=ros_covariance(covariance)
                    )
                    for pose, covariance, _ in found
                ),
                ids=tuple(identity for _, _, identity in found),
            )
        }


class Legs(Node):
    """Finds persons by their legs in a scan."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        x, y, _ = scenario.robot.lidar.position_m
        self.lidar = Pose2D(x, y)

    def reset(self, seed: int) -> None:
        """Do nothing: scans are independent."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return poses of possible persons in base_link."""
        del tick
        scan = inputs[SCAN]
        found = [
            m.PoseWithCovariance(
                pose=m.Pose.planar(self.lidar.compose(pose)), covariance=ros_covariance(covariance)
            )
            for pose, covariance in persons(clusters_of(scan))
        ]
        header = m.Header(stamp=scan.header.stamp, frame_id="base_link")
        return {LEGS: m.Observation(header=header, poses=tuple(found))}
