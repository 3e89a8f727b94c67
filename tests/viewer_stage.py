"""A simulation for the viewer's tests: a bus with the samples of services."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from harness import load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import Bus
from mecazen.config import RobotConfig, Scenario, StartConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import diagonal_covariance
from mecazen.robot import WHEEL_JOINTS
from mecazen.runtime.process import observe
from mecazen.urdf import RobotDescription, serve_description
from mecazen.wire import Stamp

TICK_NS = 10_000_000
SEED = 7
COVARIANCE = diagonal_covariance((0.01, 0.01, 0.0, 0.0, 0.0, 0.04))
URDF = """<robot name="toy">
  <link name="base_link"><visual><geometry><box size="0.4 0.3 0.1"/></geometry></visual></link>
  <link name="wheel"><visual><geometry><cylinder radius="0.05" length="0.04"/></geometry></visual>
  </link>
  <joint name="front_left_wheel_joint" type="continuous">
    <parent link="base_link"/><child link="wheel"/><axis xyz="0 1 0"/></joint>
</robot>"""


def values(entities: Mapping[str, Any], path: str, component: str) -> np.ndarray:
    """Return the logged values of a component of a path, such as `Transform3D:translation`."""
    batches = entities[path].as_component_batches()
    logged = {str(batch.component_descriptor()): batch for batch in batches}
    return np.array(logged[component].as_arrow_array().to_pylist())


def paths_of(viewer: Any, recording: Any) -> set[str]:
    """The paths of all entities that a native viewer has of a recording."""
    schema = viewer.get_recording_schema(recording.store_id, paths_only=True)
    return {entity.entity_path for entity in schema.entities}


class Stage:
    """Publishes ticks of robots that drive in circles, each after a person.

    The picture of each run is kept in memory, unless the viewer sends it elsewhere.
    """

    def __init__(self, *, described: bool = True, robots: Sequence[str] = ()) -> None:
        self.bus = Bus()
        self.names = robots or ("",)
        if described:
            for robot in self.names:
                serve_description(self.bus, robot, RobotDescription(URDF, {}))
        members = tuple(
            RobotConfig(name=name, start=StartConfig(y_m=float(number)))
            for number, name in enumerate(robots)
        )
        scenario = Scenario(robot=load_robot(), robots=members)
        self.viewer = observe("viewer", self.bus, scenario)
        self.viewer.send = self._take
        self.shown: list[str] = []
        """The names of the recordings that it has begun."""
        self.memories: list[Any] = []

    def play(self, run: int, ticks: int, begin: int = 0) -> None:
        """Publish ticks of a run, one after the other."""
        for tick in range(begin, begin + ticks):
            for number, robot in enumerate(self.names):
                self._publish(robot, number, tick, Stamp(tick * TICK_NS, run, SEED))

    def _take(self, recording: Any) -> None:
        self.shown.append(recording.get_recording_id())
        self.memories.append(recording.memory_recording())

    def _publish(self, name: str, number: int, tick: int, stamp: Stamp) -> None:
        # each robot a tenth of a turn behind the one before
        angle = tick / 500 - math.tau / 10 * number
        robot = Pose2D(2 * math.cos(angle), 2 * math.sin(angle), angle + math.pi / 2)
        person = robot.compose(Pose2D(1.0))
        ahead = Twist2D(0.4)
        odom = m.planar_odometry(stamp.time, "odom", "base_link", robot, ahead)
        seen = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), COVARIANCE)
        estimate = m.Odometry(pose=m.PoseWithCovariance(m.Pose.planar(person), COVARIANCE))
        said = {
            keys.GROUND_TRUTH: odom,
            keys.JOINT_STATES: m.JointState(
                name=WHEEL_JOINTS, position=(0.1 * tick,) * 4, velocity=(10.0,) * 4
            ),
            keys.TARGET_ODOM: m.planar_odometry(stamp.time, "world", "person", person, ahead),
            keys.OBSERVATION: m.Observation(m.Header(stamp.time, "base_link"), (seen,)),
            keys.ODOM: odom,
            keys.FOLLOWER_STATE: m.FollowerState(
                tracking="following", estimate=(estimate,), goal=(m.Pose.planar(robot),)
            ),
            keys.CMD_VEL: m.Twist.planar(ahead),
        }
        for topic, message in said.items():
            self.bus.publisher(keys.of_robot(topic, name)).put(message, stamp)
