"""The target: the walking person, and what the robot's sensor sees of them."""

from __future__ import annotations

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.messages import (
    Header,
    Observation,
    Odometry,
    Pose,
    PoseWithCovariance,
    Time,
    Twist,
    planar_odometry,
)
from mecazen.service import NS_PER_S, Service
from mecazen.wire import Stamp

from mecazen_target.config import TargetConfig
from mecazen_target.sensor import Frame, Sensor
from mecazen_target.walker import Walker

MAX_SPEED = 10.0
"""No person moves or turns faster [m/s, rad/s]: a command that wants it is refused."""


class TargetService(Service):
    """The person walks a path, or is driven by `target/cmd_vel`.

    At every tick the robot's true pose is answered by the person's, and in ticks that bring
    a frame of the sensor, by what the sensor saw.
    """

    NAME = "target"
    PRIORITY = 2

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        config = scenario.section(TargetConfig, "target")
        try:
            self.walker = Walker(config, scenario.sim.tick_s)
        except ValueError as error:
            raise ConfigError(f"target.path: {error}") from None
        self.odom = bus.publisher(keys.TARGET_ODOM)
        self.observation = bus.publisher(keys.OBSERVATION)
        super().__init__(bus, scenario)
        self.answer_every_tick(keys.GROUND_TRUTH, self.on_ground_truth)
        self.subscribe(keys.TARGET_CMD_VEL, self.on_cmd_vel, advances_clock=False)

    def reset(self, seed: int) -> None:
        """Stand at the start, with noise from `seed`."""
        self.walker.reset()
        self.pose = self.walker.at(0).pose
        self.sensor = Sensor(self.scenario.sensor, seed, self.scenario.sim.tick_s)

    def on_ground_truth(self, robot: Odometry, stamp: Stamp) -> None:
        """Publish the person's pose, and the frame of this tick if it brings one."""
        tick = self.tick_of(stamp)
        person = self.walker.at(tick)
        self.pose = person.pose
        self.odom.put(
            planar_odometry(stamp.time, "world", "person", person.pose, person.twist), stamp
        )
        frame = self.sensor.observe(tick, robot.pose.pose.to_planar(), person.pose)
        if frame is not None:
            self.observation.put(self._message(frame), stamp)

    def on_cmd_vel(self, twist: Twist, stamp: Stamp | None) -> None:
        """Move the person by hand, where the path is `driven`."""
        del stamp
        wanted = twist.to_planar()
        if any(abs(speed) > MAX_SPEED for speed in wanted):
            self.bus.refuse(keys.TARGET_CMD_VEL.key, f"speed out of range: {tuple(wanted)}")
            return
        self.walker.command(wanted)

    def _message(self, frame: Frame) -> Observation:
        captured = Time.from_ns(frame.capture_tick * self.tick_ns)
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
        """Return where the person is, and how far they have walked."""
        x, y, _ = self.pose
        return {
            "time_s": self.stamp.time_ns / NS_PER_S,
            "x_m": round(x, 3),
            "y_m": round(y, 3),
            "walked_m": round(self.walker.distance, 3),
        }
