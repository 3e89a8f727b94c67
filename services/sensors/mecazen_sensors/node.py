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

from mecazen_sensors.depth import DepthCamera
from mecazen_sensors.lidar import Lidar
from mecazen_sensors.scene import CARRIER, Scene
from mecazen_sensors.tracker import Tracker


class _Sensor(Node):
    """A sensor on the robot that sees people, other robots, obstacles and the ground."""

    key: ClassVar[str]
    """The sensor's section of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.own = scenario.robot_name or "target"
        """The name of the person whom this robot follows."""
        self.robots = [scenario.robot, *scenario.others.values()]
        self.scene = Scene(scenario.world, self.robots)
        self.around = m.People()
        """All people and robots, as last received."""
        self.period = scenario.ticks_per(f"{self.key}.rate_hz")
        self._check_captures(self.period)

    def _place(self, inputs: Inputs) -> tuple[Pose2D, list[Floats]]:
        """Place all people and robots; return the robot's pose and the joints of all people.

        In real time the robot's pose may come too late for its tick. A sensor then skips the frame.
        The person whom the robot follows is the first, and the others keep their order.
        """
        robot = inputs[GROUND_TRUTH].pose.pose.to_planar()
        body = inputs[TARGET_SKELETON]
        self.around = around = inputs.get(PEOPLE) or self.around
        bodies = [(body.joints, body.height)]
        bodies += [
            (one.joints, one.height)
            for one in around.persons
            if one.id != self.own and len(one.joints) == len(JOINTS)
        ]
        people = [np.array([(p.x, p.y, p.z) for p in joints]) for joints, _ in bodies]
        if len(people) > self.scene.people:
            self.scene = Scene(self.scenario.world, self.robots, len(people))
        self.scene.place_robot(CARRIER, robot)
        places = {one.name: one.pose.to_planar() for one in around.robots}
        for number, name in enumerate(self.scenario.others, 1):
            if name in places:
                self.scene.place_robot(number, places[name])
        for number, (joints, (_, height)) in enumerate(zip(people, bodies, strict=True)):
            self.scene.place_person(number, joints, height)
        return robot, people

    def _check_captures(self, ticks: int) -> None:
        """Refuse a sensor whose captures are not at updates of the body."""
        if ticks % self.scenario.ticks_per("sensors.skeleton_rate_hz"):
            raise ConfigError(
                f"{self.key}: period and latency must be whole multiples of the skeleton's period: "
                f"sensors.skeleton_rate_hz = {self.scenario.sensors.skeleton_rate_hz:g}"
            )

    def _is_due(self, tick: Tick, inputs: Inputs) -> bool:
        return tick.number % self.period == 0 and inputs.get(GROUND_TRUTH) is not None


class LidarNode(_Sensor):
    """Scans the surroundings."""

    key = "sensors.lidar"

    def reset(self, seed: int) -> None:
        """Begin a run with noise from `seed`."""
        self.lidar = Lidar(self.scenario.sensors.lidar, self.scenario.robot.lidar, seed)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return a scan when one is due."""
        if not self._is_due(tick, inputs):
            return {}
        robot, _ = self._place(inputs)
        return {SCAN: self.lidar.scan(self.scene, robot, tick.time)}


class TrackerNode(_Sensor):
    """Tracks the joints of persons."""

    key = "sensors.tracker"

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        latency_s, tick_s = scenario.sensors.tracker.latency_s, scenario.sim.tick_s
        self._check_captures(whole_ticks(f"{self.key}.latency_s", latency_s, tick_s))

    def reset(self, seed: int) -> None:
        """Begin a run with errors from `seed`."""
        of = self.scenario
        self.tracker = Tracker(of.sensors.tracker, of.robot.camera, seed, of.sim.tick_s)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the frame that arrives, if one does."""
        robot, people = Pose2D(), list[Floats]()
        if self.tracker.captures(tick.number):
            if inputs.get(GROUND_TRUTH) is None:
                return {}
            robot, people = self._place(inputs)
        frame = self.tracker.observe(tick.number, self.scene, robot, people)
        return {} if frame is None else {SKELETONS: frame}


class DepthNode(_Sensor):
    """Captures depth images."""

    key = "sensors.depth"

    def reset(self, seed: int) -> None:
        """Begin a run with noise from `seed`."""
        self.camera = DepthCamera(self.scenario.sensors.depth, self.scenario.robot.camera, seed)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return an image when one is due, and the camera's projection."""
        if not self._is_due(tick, inputs):
            return {}
        robot, _ = self._place(inputs)
        image = self.camera.picture(self.scene, robot, tick.time)
        return {DEPTH: image, CAMERA_INFO: self.camera.info(tick.time)}
