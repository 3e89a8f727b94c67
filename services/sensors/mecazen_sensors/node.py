"""The nodes of the sensors: from true poses to measurements."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.keys import CAMERA_INFO, DEPTH, GROUND_TRUTH, PEOPLE, SCAN, SKELETONS, TARGET_SKELETON
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.portable import Floats
from mecazen.skeleton import JOINTS
from mecazen.ticks import whole_ticks

from mecazen_sensors.camera import DepthCamera
from mecazen_sensors.lidar import Lidar
from mecazen_sensors.raycast import CARRIER, RayScene
from mecazen_sensors.tracker import BodyTracker


class _Sensor(Node):
    """A sensor on the robot that sees people, other robots, obstacles and the ground."""

    key: ClassVar[str]
    """The sensor's section of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.followed = scenario.robot_name or "target"
        """The name of the person whom this robot follows."""
        self.robots = [scenario.robot, *scenario.others.values()]
        self.scene = RayScene(scenario.world, self.robots)
        self.people = m.People()
        """All people and robots, as last received."""
        self.period = scenario.ticks_per(f"{self.key}.rate_hz")
        self._check_captures(self.period)

    def _check_captures(self, ticks: int) -> None:
        """Refuse a sensor whose captures are not at updates of the body."""
        if ticks % self.scenario.ticks_per("sensors.skeleton_rate_hz"):
            raise ConfigError(
                f"{self.key}: period and latency must be whole multiples of the skeleton's period: "
                f"sensors.skeleton_rate_hz = {self.scenario.sensors.skeleton_rate_hz:g}"
            )

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return a measurement when one is due.

        In real time the robot's pose may come too late for its tick. A sensor then skips the frame.
        """
        if tick.number % self.period or inputs.get(GROUND_TRUTH) is None:
            return {}
        robot, _ = self._place(inputs)
        return self._capture(robot, tick.time)

    def _capture(self, robot: Pose2D, time: m.Time) -> Outputs:
        """Return the measurement from a true pose of the robot."""
        raise NotImplementedError

    def _place(self, inputs: Inputs) -> tuple[Pose2D, list[Floats]]:
        """Place all people and robots; return the robot's pose and the joints of all people.

        The person whom the robot follows is the first, and the others keep their order.
        """
        robot = inputs[GROUND_TRUTH].pose.pose.to_planar()
        self.people = inputs.get(PEOPLE) or self.people
        bodies: list[m.Skeleton | m.Person] = [inputs[TARGET_SKELETON]]
        bodies += [
            person
            for person in self.people.persons
            if person.id != self.followed and len(person.joints) == len(JOINTS)
        ]
        if len(bodies) > self.scene.people:
            self.scene = RayScene(self.scenario.world, self.robots, len(bodies))
        self.scene.place_robot(CARRIER, robot)
        poses = {named.name: named.pose.to_planar() for named in self.people.robots}
        for number, name in enumerate(self.scenario.others, 1):
            if name in poses:
                self.scene.place_robot(number, poses[name])
        joints = [np.array([(p.x, p.y, p.z) for p in body.joints]) for body in bodies]
        for number, body in enumerate(bodies):
            self.scene.place_person(number, joints[number], body.height)
        return robot, joints


class LidarNode(_Sensor):
    """Scans the surroundings."""

    key = "sensors.lidar"

    def reset(self, seed: int) -> None:
        """Begin a run with noise from `seed`."""
        self.lidar = Lidar(self.scenario.sensors.lidar, self.scenario.robot.lidar, seed)

    def _capture(self, robot: Pose2D, time: m.Time) -> Outputs:
        return {SCAN: self.lidar.scan(self.scene, robot, time)}


class DepthNode(_Sensor):
    """Captures depth images."""

    key = "sensors.depth"

    def reset(self, seed: int) -> None:
        """Begin a run with noise from `seed`."""
        self.camera = DepthCamera(self.scenario.sensors.depth, self.scenario.robot.camera, seed)

    def _capture(self, robot: Pose2D, time: m.Time) -> Outputs:
        image = self.camera.picture(self.scene, robot, time)
        return {DEPTH: image, CAMERA_INFO: self.camera.info(time)}


class TrackerNode(_Sensor):
    """Tracks the joints of persons."""

    key = "sensors.tracker"

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        latency_s, tick_s = scenario.sensors.tracker.latency_s, scenario.sim.tick_s
        self._check_captures(whole_ticks(f"{self.key}.latency_s", latency_s, tick_s))

    def reset(self, seed: int) -> None:
        """Begin a run with errors from `seed`."""
        config, mount = self.scenario.sensors.tracker, self.scenario.robot.camera
        self.tracker = BodyTracker(config, mount, seed, self.scenario.sim.tick_s)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the frame that arrives, if one does."""
        robot, people = Pose2D(), list[Floats]()
        if self.tracker.captures(tick.number):
            if inputs.get(GROUND_TRUTH) is None:
                return {}
            robot, people = self._place(inputs)
        frame = self.tracker.observe(tick.number, self.scene, robot, people)
        return {} if frame is None else {SKELETONS: frame}
