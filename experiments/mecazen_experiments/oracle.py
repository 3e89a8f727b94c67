"""A follower that is told the truth: what its errors are is the share of control and robot."""

from __future__ import annotations

from functools import partial
from typing import Any

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.messages import Odometry, Twist
from mecazen.service import NS_PER_S, Service
from mecazen.wire import Stamp
from mecazen_follower.config import FollowerConfig
from mecazen_follower.estimators import Array, Estimate, Estimator, Params
from mecazen_follower.following import Following, Measurement

CERTAIN = (1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1e-12)
"""Covariance of what is known; not 0, which would say that it is unknown."""


class Truth(Estimator):
    """The person as they are; told, not estimated."""

    def __init__(self) -> None:
        super().__init__(Params())
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._person: Estimate | None = None

    def tell(self, pose: Pose2D, velocity: Twist2D) -> None:
        """Take the person's pose and velocity, both in odom."""
        self._person = Estimate(pose, velocity, CERTAIN)

    def predict(self, dt: float) -> None:
        """Wait to be told."""

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        """Know better."""

    @property
    def estimate(self) -> Estimate | None:
        """The person."""
        return self._person


class OracleFollower(Service):
    """The scenario's control law with the true person in the place of an estimate.

    The person is known relative to the true robot and placed in odom by where the odometry
    believes the robot to be, as an observation is.
    """

    NAME = "follower"

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self._config = scenario.section(FollowerConfig, "follower")
        self._dt = scenario.sim.tick_s
        self._cmd_vel = bus.publisher(keys.CMD_VEL)
        super().__init__(bus, scenario)
        for topic in (keys.ODOM, keys.GROUND_TRUTH, keys.TARGET_ODOM):
            self.answer_every_tick(topic, partial(self._on_sample, topic.key))

    def reset(self, seed: int) -> None:
        """Begin a run."""
        del seed
        self._truth = Truth()
        self._following = Following(self._config, 0.0)
        self._following.estimator = self._truth
        self._heard: dict[str, tuple[Any, Stamp]] = {}

    def _on_sample(self, key: str, message: Odometry, stamp: Stamp) -> None:
        self._heard[key] = message, stamp
        if len(self._heard) == 3 and len({at for _, at in self._heard.values()}) == 1:
            self._answer(stamp)

    def _answer(self, stamp: Stamp) -> None:
        odom, robot, person = (
            self._heard[topic.key][0].pose.pose.to_planar()
            for topic in (keys.ODOM, keys.GROUND_TRUTH, keys.TARGET_ODOM)
        )
        seen = odom.compose(robot.between(person))
        twist = self._heard[keys.TARGET_ODOM.key][0].twist.twist.to_planar()
        self._truth.tell(seen, Twist2D(*rotate(twist.x, twist.y, seen.yaw), twist.yaw))
        time = stamp.time_ns / NS_PER_S
        step = self._following.step(time, self._dt, odom, Measurement(seen, CERTAIN))
        self._cmd_vel.put(Twist.planar(step.command), stamp)
