"""The target on the bus: what no payload can do to it."""

import pytest
from harness import Rig, assert_sendable, load_robot
from hostile import forged, malformed
from mecazen import keys
from mecazen.config import Scenario, SensorConfig, TargetConfig
from mecazen.config.people import Driven
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import Time, Twist, planar_odometry

NEXT_RUN = 2**32 - 1


class Target(Rig):
    """A driven person, and a sensor without noise."""

    def __init__(self):
        scenario = Scenario(
            robot=load_robot(),
            sensor=SensorConfig(position_std_m=0.0, yaw_std_deg=0.0),
            target=TargetConfig(path=Driven(timeout_s=0.05)),
        )
        super().__init__("target", scenario, keys.TARGET_ODOM, keys.OBSERVATION)

    def tick(self, tick, y=0.0, run=1):
        """Return what comes of a tick in which the robot truly is at `y` [m]."""
        truth = planar_odometry(Time(), "world", "base_link", Pose2D(y=y), Twist2D())
        return self.put(keys.GROUND_TRUTH, truth, self.at(tick, run))

    def assert_walks(self, run=1):
        """Drive the person for four ticks, without a stamp, and look at them in the last."""
        self.bus.put_bytes("target/cmd_vel", b'{"linear":{"x":1.0}}')
        for tick in range(1, 4):
            (odom,) = self.tick(tick, run=run)
            assert (odom.key, odom.stamp) == ("target/odom", self.at(tick, run))
            assert odom.message.pose.pose.position.x == pytest.approx(0.01 * tick)
        _, frame = self.tick(4, 1.0, run)
        assert (frame.key, frame.stamp) == ("target/observation", self.at(4, run))
        assert frame.message.poses[0].pose.to_planar() == pytest.approx((0.04, -1.0, 0.0))


TRUTH = planar_odometry(Time(1), "world", "base_link", Pose2D(1.0, 2.0, 0.5), Twist2D(0.1))
COMMAND = Twist.planar(Twist2D(0.1, 0.2, 0.3))


@malformed({"ground_truth/odom": [TRUTH]})
def test_malformed_payloads_change_nothing_for_the_run(wrong):
    rig = Target()
    rig.tick(0)
    assert rig.put_wrong(wrong) == []
    rig.assert_walks()


@forged({"ground_truth/odom": [TRUTH], "target/cmd_vel": [COMMAND]})
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(wrong):
    rig = Target()
    rig.tick(0)
    rig.put_wrong(wrong)
    for sample in rig.tick(5):
        assert_sendable(sample)
    assert rig.tick(0, run=NEXT_RUN)[0].message.pose.pose.to_planar() == Pose2D()
    rig.assert_walks(NEXT_RUN)
