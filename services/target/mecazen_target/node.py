"""The target: the walking person, and what the robot's sensor sees of them."""

from __future__ import annotations

from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import TABLE
from mecazen.keys import GROUND_TRUTH, OBSERVATION, TARGET_CMD_VEL, TARGET_ODOM, Topic
from mecazen.messages import (
    Header,
    Message,
    Observation,
    Pose,
    PoseWithCovariance,
    Time,
    planar_odometry,
)
from mecazen.node import Inputs, Node, Outputs, Tick

from mecazen_target.config import TargetConfig
from mecazen_target.sensor import Frame, Sensor
from mecazen_target.walker import Walker


class TargetNode(Node):
    """The person walks a path, or is driven by `target/cmd_vel`."""

    ROW = TABLE["target"]

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        try:
            self.walker = Walker(scenario.section(TargetConfig, "target"), scenario.sim.tick_s)
        except ValueError as error:
            raise ConfigError(f"target.path: {error}") from None
        Sensor(scenario.sensor, 0, scenario.sim.tick_s)  # refuses what does not suit the tick

    def reset(self, seed: int) -> None:
        """Stand at the start, with noise from `seed`."""
        self.walker.reset()
        self.pose = self.walker.at(0).pose
        self.time_s = 0.0
        self.sensor = Sensor(self.scenario.sensor, seed, self.scenario.sim.tick_s)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the person's pose, and in ticks that bring a frame what the sensor saw."""
        command = inputs.get(TARGET_CMD_VEL)
        if command is not None:
            self.walker.command(command.to_planar())
        person = self.walker.at(tick.number)
        self.pose, self.time_s = person.pose, tick.time_ns / 1e9
        outputs: dict[Topic[Any], Message] = {
            TARGET_ODOM: planar_odometry(tick.time, "world", "person", person.pose, person.twist)
        }
        robot = inputs[GROUND_TRUTH].pose.pose.to_planar()
        frame = self.sensor.observe(tick.number, robot, person.pose)
        if frame is not None:
            outputs[OBSERVATION] = self._message(frame)
        return outputs

    def _message(self, frame: Frame) -> Observation:
        captured = Time.from_ns(frame.capture_tick * self.scenario.sim.tick_ns)
        seen = (
            ()
            if frame.pose is None
            else (
                PoseWithCovariance(pose=Pose.planar(frame.pose), covariance=self.sensor.covariance),
            )
        )
        header = Header(stamp=captured, frame_id=self.scenario.sensor.frame)
        return Observation(header=header, poses=seen)

    def diagnostics(self) -> dict[str, object]:
        """Return where the person is, and the distance walked."""
        x, y, _ = self.pose
        return {
            "time_s": self.time_s,
            "x_m": round(x, 3),
            "y_m": round(y, 3),
            "walked_m": round(self.walker.distance, 3),
        }
