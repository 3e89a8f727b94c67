"""A simulation for the viewer's tests: a bus on which somebody says what services say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from harness import load_robot
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import RobotConfig, Scenario, StartConfig
from mecazen.covariance import diagonal_covariance
from mecazen.description import RobotDescription, serve_description
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import (
    FollowerState,
    Header,
    JointState,
    Observation,
    Odometry,
    Pose,
    PoseWithCovariance,
    Twist,
    planar_odometry,
)
from mecazen.robot import WHEEL_JOINTS
from mecazen.wire import Stamp
from mecazen_viewer.components import Components
from mecazen_viewer.service import ViewerService

TICK_NS = 10_000_000
SEED = 7
"""Of the first robot; each has its own."""
COVARIANCE = diagonal_covariance((0.01, 0.01, 0.0, 0.0, 0.0, 0.04))
URDF = """<robot name="toy">
  <link name="base_link"><visual><geometry><box size="0.4 0.3 0.1"/></geometry></visual></link>
  <link name="wheel"><visual><geometry><cylinder radius="0.05" length="0.04"/></geometry></visual>
  </link>
  <joint name="front_left_wheel_joint" type="continuous">
    <parent link="base_link"/><child link="wheel"/><axis xyz="0 1 0"/></joint>
</robot>"""


def values(entities: Mapping[str, Components], path: str, component: str) -> np.ndarray:
    """What is logged for a component of a path, such as `Transform3D:translation`."""
    logged = {str(batch.component_descriptor()): batch for batch in entities[path]}
    return np.array(logged[component].as_arrow_array().to_pylist())


class Stage:
    """Publishes ticks of robots that drive in circles, each after a person."""

    def __init__(self, *, described: bool = True, robots: Sequence[str] = ()) -> None:
        self.bus = LocalBus()
        self.names = robots or ("",)
        if described:
            for robot in self.names:
                serve_description(self.bus.namespaced(robot), RobotDescription(URDF, {}))
        members = tuple(
            RobotConfig(name=name, start=StartConfig(y_m=float(number)))
            for number, name in enumerate(robots)
        )
        self.viewer = ViewerService(
            "viewer", self.bus, Scenario(robot=load_robot(), robots=members)
        )

    def play(self, run: int, ticks: int, begin: int = 0) -> None:
        """Publish ticks of a run, one after the other."""
        for tick in range(begin, begin + ticks):
            for number, robot in enumerate(self.names):
                stamp = Stamp(tick * TICK_NS, run, SEED + number)
                self._publish(self.bus.namespaced(robot), tick, stamp)
            self.bus.spin()

    def _publish(self, bus: LocalBus, tick: int, stamp: Stamp) -> None:
        # each robot a tenth of a turn behind the one before
        angle = tick / 500 - math.tau / 10 * (stamp.seed - SEED)
        robot = Pose2D(2 * math.cos(angle), 2 * math.sin(angle), angle + math.pi / 2)
        person = robot.compose(Pose2D(1.0))
        odom = planar_odometry(stamp.time, "odom", "base_link", robot, Twist2D(0.4))
        seen = PoseWithCovariance(pose=Pose.planar(Pose2D(1.0)), covariance=COVARIANCE)
        header = Header(stamp=stamp.time, frame_id="base_link")
        estimate = Odometry(
            pose=PoseWithCovariance(pose=Pose.planar(person), covariance=COVARIANCE)
        )
        said = {
            keys.GROUND_TRUTH: odom,
            keys.JOINT_STATES: JointState(
                name=WHEEL_JOINTS, position=(0.1 * tick,) * 4, velocity=(10.0,) * 4
            ),
            keys.TARGET_ODOM: planar_odometry(stamp.time, "world", "person", person, Twist2D(0.4)),
            keys.OBSERVATION: Observation(header=header, poses=(seen,)),
            keys.ODOM: odom,
            keys.FOLLOWER_STATE: FollowerState(
                tracking="following", estimate=(estimate,), goal=(Pose.planar(robot),)
            ),
            keys.CMD_VEL: Twist.planar(Twist2D(0.4)),
        }
        for topic, message in said.items():
            bus.publisher(topic).put(message, stamp)
