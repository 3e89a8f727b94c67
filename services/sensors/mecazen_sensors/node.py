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

NO_PERSON: Outputs = {SKELETONS: m.Skeletons(header=m.Header(frame_id="base_link"))}


class _Sensor(Node):
    """A sensor on the robot that sees people, other robots, obstacles and the ground."""

    key: ClassVar[str]
    """The sensor's section of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.followed = scenario.robot_name or "target"
        """The name of the person whom this robot follows."""
        self.robots = [scenario.robot, *scenario.others.values()]
        self.period = scenario.ticks_per(f"{self.key}.rate_hz")
        self.latency = 0
        """Ticks from a capture to the arrival of its frame."""
        self._check_captures(self.period)

    def _check_captures(self, ticks: int) -> None:
        """Refuse a sensor whose captures are not at updates of the body."""
        if ticks % self.scenario.ticks_per("sensors.skeleton_rate_hz"):
            raise ConfigError(
                f"{self.key}: period and latency must be whole multiples of the skeleton's period: "
                f"sensors.skeleton_rate_hz = {self.scenario.sensors.skeleton_rate_hz:g}"
            )

    def reset(self, seed: int) -> None:
        self.scene = RayScene(self.scenario.world, self.robots)
        self.people = m.People()
        """All people and robots, as last received."""

    def configure(self, scenario: Scenario) -> None:
        if scenario.world != self.scenario.world:
            self.scene = RayScene(scenario.world, self.robots, self.scene.people)
        super().configure(scenario)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return a measurement when one is due.

        In real time the robot's pose may come too late for its tick. A sensor then skips the frame.
        """
        self.people = inputs.get(PEOPLE) or self.people
        if (tick.number + self.latency) % self.period or inputs.get(GROUND_TRUTH) is None:
            return {}
        robot, people = self._place(inputs)
        return self._capture(robot, people, tick.time)

    def _capture(self, robot: Pose2D, people: dict[str, Floats], time: m.Time) -> Outputs:
        """Return the measurement from a true pose of the robot, with the joints of all people."""
        raise NotImplementedError

    def _place(self, inputs: Inputs) -> tuple[Pose2D, dict[str, Floats]]:
        """Place all people and robots; return the robot's pose and the joints of all people by id.

        The person whom the robot follows is the first, and the others keep their order. People who
        are no longer reported are removed. If no report comes, all stand still, as in physics.
        """
        robot = inputs[GROUND_TRUTH].pose.pose.to_planar()
        bodies: dict[str, m.Skeleton | m.Person] = {self.followed: inputs[TARGET_SKELETON]}
        bodies |= {
            person.id: person
            for person in self.people.persons
            if person.id != self.followed and len(person.joints) == len(JOINTS)
        }
        if len(bodies) > self.scene.people:
            self.scene = RayScene(self.scenario.world, self.robots, len(bodies))
        self.scene.place_robot(CARRIER, robot)
        poses = {named.name: named.pose.to_planar() for named in self.people.robots}
        for number, name in enumerate(self.scenario.others, 1):
            if name in poses:
                self.scene.place_robot(number, poses[name])
        people = {
            name: np.array([(p.x, p.y, p.z) for p in body.joints]) for name, body in bodies.items()
        }
        for number, (name, body) in enumerate(bodies.items()):
            self.scene.place_person(number, people[name], body.height)
        for number in range(len(bodies), self.scene.people):
            self.scene.remove_person(number)
        return robot, people


class LidarNode(_Sensor):
    """Scans the surroundings."""

    key = "sensors.lidar"

    def reset(self, seed: int) -> None:
        super().reset(seed)
        mount = self.scenario.robot.lidar
        assert mount is not None
        self.lidar = Lidar(self.scenario.sensors.lidar, mount, seed)

    def _capture(self, robot: Pose2D, people: dict[str, Floats], time: m.Time) -> Outputs:
        return {SCAN: self.lidar.scan(self.scene, robot, time)}


class DepthNode(_Sensor):
    """Captures depth images."""

    key = "sensors.depth"

    def reset(self, seed: int) -> None:
        super().reset(seed)
        mount = self.scenario.robot.camera
        assert mount is not None
        self.camera = DepthCamera(self.scenario.sensors.depth, mount, seed)

    def _capture(self, robot: Pose2D, people: dict[str, Floats], time: m.Time) -> Outputs:
        image = self.camera.picture(self.scene, robot, time)
        return {DEPTH: image, CAMERA_INFO: self.camera.info(time)}


class TrackerNode(_Sensor):
    """Tracks the joints of persons; its frames arrive late."""

    key = "sensors.tracker"

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        latency_s, tick_s = scenario.sensors.tracker.latency_s, scenario.sim.tick_s
        self.latency = whole_ticks(f"{self.key}.latency_s", latency_s, tick_s)
        self._check_captures(self.latency)

    def reset(self, seed: int) -> None:
        super().reset(seed)
        config, mount = self.scenario.sensors.tracker, self.scenario.robot.camera
        assert mount is not None
        self.tracker = BodyTracker(config, mount, seed, self.period * self.scenario.sim.tick_s)
        self.in_transit: dict[int, Outputs] = {}
        """Frames by the tick of their arrival."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the frame that arrives, if one does.

        A frame whose capture was missed, or was before the start, shows no person.
        """
        if frame := super().step(tick, inputs):
            self.in_transit[tick.number + self.latency] = frame
        arrived = self.in_transit.get(tick.number, NO_PERSON)
        self.in_transit = {due: f for due, f in self.in_transit.items() if due > tick.number}
        return {} if tick.number % self.period else arrived

    def _capture(self, robot: Pose2D, people: dict[str, Floats], time: m.Time) -> Outputs:
        return {SKELETONS: self.tracker.capture(self.scene, robot, people, time)}
