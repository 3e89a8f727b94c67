"""The follower's node, stepped by hand."""

import msgspec
from harness import Steps, load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.config import FollowerConfig, Scenario, SensorConfig
from mecazen.config.follower import AngularGains, LinearGains, PidControl
from mecazen.geometry import Pose2D, Twist2D
from mecazen_follower.node import FollowerNode

NEXUS = load_robot()
ZEROS = (0.0,) * 36
ORIGIN, PERSON = Pose2D(), Pose2D(1.5, 0.3, 0.2)
_LINEAR = LinearGains(kp=1.0, ki=0.0, limit=2.0)
PROPORTIONAL = PidControl(_LINEAR, _LINEAR, AngularGains(kp=1.0, ki=0.0, limit=2.0))
"""1 m/s for each metre that is missing."""


class Follower(Steps):
    """Uses observations unfiltered, and drives at 1 m/s for each metre by default."""

    def __init__(
        self,
        tick_s=None,
        latency_s=0.0,
        kind="pose",
        fov_deg=360.0,
        services=("physics", "sensors", "controller"),
        **settings,
    ):
        config = FollowerConfig(**{"estimator": "none", "control": PROPORTIONAL, **settings})
        sensor = SensorConfig(kind=kind, latency_s=latency_s, fov_deg=fov_deg)
        scenario = Scenario(NEXUS, services=services, sensor=sensor, follower=config)
        super().__init__(FollowerNode, scenario, tick_s)

    def tick(
        self,
        tick,
        robot=ORIGIN,
        person=None,
        *,
        captured=None,
        seen_in="base_link",
        noise=ZEROS,
        topic=keys.OBSERVATION,
        **samples,
    ):
        """Return command and state of a tick; its frame is empty where no person is given."""
        now = m.Time.from_ns(tick * self.tick_ns)
        samples = {getattr(keys, name.upper()): message for name, message in samples.items()}
        samples[keys.ODOM] = m.planar_odometry(now, "odom", "base_link", robot, Twist2D())
        if person is not None or tick % 4 == 0:
            time = m.Time.from_ns((tick if captured is None else captured) * self.tick_ns)
            poses = () if person is None else (m.PoseWithCovariance(m.Pose.planar(person), noise),)
            samples[topic] = m.Observation(m.Header(time, seen_in), poses)
        outputs = self.step(tick, samples)
        assert list(outputs) == [keys.FOLLOWER_STATE, keys.CMD_VEL]
        state = outputs[keys.FOLLOWER_STATE]
        assert state.header == m.Header(now, "odom")
        return outputs[keys.CMD_VEL].to_planar(), state

    def drive(self, ticks):
        """Return the outputs for a robot that moves along x past a standing person."""
        robots = [(tick, Pose2D(0.002 * tick)) for tick in ticks]
        return [
            self.tick(tick, robot, robot.between(PERSON) if tick % 4 == 0 else None)
            for tick, robot in robots
        ]

    def configure(self, **settings):
        scenario = self.node.scenario
        section = msgspec.structs.replace(scenario.follower, **settings)
        self.node.configure(msgspec.structs.replace(scenario, follower=section))
