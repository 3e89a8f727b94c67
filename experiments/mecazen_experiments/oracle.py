"""A follower that knows the true person: its errors are those of control and robot."""

from __future__ import annotations

from mecazen.config.follower import Params
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.keys import (
    CMD_VEL,
    FOLLOWER_STATE,
    GROUND_TRUTH,
    OBSERVATION,
    ODOM,
    SCAN,
    TARGET_ODOM,
    Topic,
)
from mecazen.messages import Observation
from mecazen.node import Inputs
from mecazen.row import Row, due, every
from mecazen.wire import NS_PER_S
from mecazen_follower.association import Measurement
from mecazen_follower.estimators import Array, Estimate, Estimator
from mecazen_follower.node import FollowerNode
from mecazen_follower.tracker import Frame

CERTAIN = (1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1e-12)
"""Covariance of the known person; not 0, which would mean unknown."""


class Truth(Estimator):
    """The true person in place of an estimate."""

    predicts = False
    estimate: Estimate | None = None

    def reset(self) -> None:
        """Forget the person."""
        self.estimate = None

    def predict(self, dt: float) -> None:
        """Do nothing: the estimate is set."""

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        """Ignore the observation: the truth is known."""


class OracleFollower(FollowerNode):
    """Our follower with the true person instead of an estimate.

    The person's true pose relative to the true robot is transformed to odom with the odometry, like
    an observation.
    """

    ROW = Row(
        "follower",
        inputs=(every(ODOM), every(GROUND_TRUTH), every(TARGET_ODOM), due(SCAN)),
        outputs=(FOLLOWER_STATE, CMD_VEL),
    )

    def reset(self, seed: int) -> None:
        """Begin a run."""
        super().reset(seed)
        self._truth = Truth(Params())
        self.following.people.estimator = self._truth

    def _frame(self, now_ns: int, inputs: Inputs, topic: Topic[Observation]) -> Frame | None:
        if topic is not OBSERVATION:
            return None
        odom, robot, person = (
            inputs[topic].pose.pose.to_planar() for topic in (ODOM, GROUND_TRUTH, TARGET_ODOM)
        )
        seen = odom.compose(robot.between(person))
        twist = inputs[TARGET_ODOM].twist.twist.to_planar()
        velocity = Twist2D(*rotate(twist.x, twist.y, seen.yaw), twist.yaw)
        self._truth.estimate = Estimate(seen, velocity, CERTAIN)
        return Frame(now_ns / NS_PER_S, [Measurement(seen, CERTAIN)])
