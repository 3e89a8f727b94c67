"""A follower that knows the true person: its errors are those of control and robot."""

from __future__ import annotations

from mecazen.config import SensorConfig
from mecazen.config.follower import Params
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.keys import CMD_VEL, GROUND_TRUTH, ODOM, SCAN, TARGET_ODOM
from mecazen.messages import Twist
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.row import Row, due, every
from mecazen.wire import NS_PER_S
from mecazen_follower.association import Measurement
from mecazen_follower.estimators import Array, Estimate, Estimator
from mecazen_follower.following import Following
from mecazen_follower.node import data_sheet, make_planner, view_of
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


class OracleFollower(Node):
    """The scenario's control law with the true person instead of an estimate.

    The person's true pose relative to the true robot is transformed to odom with the odometry, like
    an observation.
    """

    ROW = Row(
        "follower",
        inputs=(every(ODOM), every(GROUND_TRUTH), every(TARGET_ODOM), due(SCAN)),
        outputs=(CMD_VEL,),
    )

    def reset(self, seed: int) -> None:
        """Begin a run."""
        self._truth = Truth(Params())
        config = self.scenario.follower
        drive, sensor = Drive.from_scenario(self.scenario), data_sheet(self.scenario)
        planner = make_planner(self.scenario, sensor, seed)
        view = view_of(self.scenario, sensor, config)
        self._following = Following(config, SensorConfig(), drive, view, planner=planner)
        self._following.people.estimator = self._truth

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the command towards the place beside the true person."""
        odom, robot, person = (
            inputs[topic].pose.pose.to_planar() for topic in (ODOM, GROUND_TRUTH, TARGET_ODOM)
        )
        seen = odom.compose(robot.between(person))
        planner, scan = self._following.planner, inputs.get(SCAN)
        if planner is not None and scan is not None:
            lidar = odom.compose(self.scenario.robot.lidar.pose)
            # lockstep brings a scan in the tick in which it is taken
            planner.see(tick.time_ns / NS_PER_S, scan, lidar)
        twist = inputs[TARGET_ODOM].twist.twist.to_planar()
        velocity = Twist2D(*rotate(twist.x, twist.y, seen.yaw), twist.yaw)
        self._truth.estimate = Estimate(seen, velocity, CERTAIN)
        time_s = tick.time_ns / NS_PER_S
        frame = Frame(time_s, [Measurement(seen, CERTAIN)])
        step = self._following.step(time_s, tick.period_s, odom, frame)
        return {CMD_VEL: Twist.planar(step.command)}
