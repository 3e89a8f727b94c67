"""The controller on the bus: which samples make up its ticks, and what no payload can do to it."""

import math

import pytest
from harness import Rig, load_robot
from hostile import forged, malformed
from mecazen import keys
from mecazen.config import ControllerConfig, Scenario, SimConfig
from mecazen.config.controller import AngularLimits, AxisLimits, LinearLimits
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import JointState, OdometryRequest, Pose, Twist
from mecazen.robot import WHEEL_JOINTS

NEXT_RUN = 2**32 - 1
ISOLATED = ("physics", "controller")
FOLLOWER_ACTIVE = (*ISOLATED, "follower")
FREE = LinearLimits(math.inf, math.inf)
UNLIMITED = AxisLimits(FREE, FREE, AngularLimits(math.inf, 1e9))
STANDING = (0.0,) * 4


class Controller(Rig):
    """A controller that obeys at once, unless told otherwise."""

    def __init__(self, services=ISOLATED, **settings):
        config = ControllerConfig(limits=UNLIMITED, **settings)
        lockstep = SimConfig(mode="lockstep")
        scenario = Scenario(load_robot(), services=services, sim=lockstep, controller=config)
        super().__init__("controller", scenario, keys.ODOM, keys.JOINT_COMMAND)

    def tick(self, tick, speeds=STANDING, run=1):
        joints = JointState(name=WHEEL_JOINTS, velocity=speeds)
        return self.put(keys.JOINT_STATES, joints, self.at(tick, run))

    def command(self, tick, *twist, run=1):
        return self.put(keys.CMD_VEL, Twist.planar(Twist2D(*twist)), self.at(tick, run))


def test_where_nobody_leads_joint_states_are_answered_at_once_and_later_commands_replace_that():
    rig = Controller()
    odom, command = rig.tick(7)
    assert (odom.key, command.key) == ("odom", "joint_command")
    assert odom.stamp == command.stamp == rig.at(7)
    assert command.message.velocity == STANDING
    for speed in (0.1, 0.2):  # from outside, without a stamp
        rig.bus.put_bytes("cmd_vel", b'{"linear":{"x":%f}}' % speed)
        (again,) = rig.take()
        assert (again.key, again.stamp) == ("joint_command", rig.at(7))
        assert again.message.velocity == pytest.approx([speed / 0.05] * 4)


def test_where_a_follower_leads_the_command_waits_for_its_cmd_vel():
    rig = Controller(FOLLOWER_ACTIVE)
    (odom,) = rig.tick(0)
    (command,) = rig.command(0, 0.1)
    assert (odom.key, command.key, command.stamp) == ("odom", "joint_command", rig.at(0))
    assert command.message.velocity == pytest.approx([2.0] * 4)


def test_a_tick_in_which_no_odometry_comes_does_not_wait_for_the_follower():
    rig = Controller(FOLLOWER_ACTIVE, update_rate_hz=25.0)
    assert [sample.key for sample in rig.tick(0)] == ["odom"]
    rig.command(0, 0.1)
    for tick in (1, 2, 3):
        (command,) = rig.tick(tick)
        assert (command.key, command.stamp) == ("joint_command", rig.at(tick))
    assert [sample.key for sample in rig.tick(4)] == ["odom"]


def test_set_odometry_is_answered_on_the_bus():
    rig = Controller()
    rig.tick(0)
    answer = rig.bus.call(keys.SET_ODOMETRY, OdometryRequest(pose=Pose.planar(Pose2D(5.0))))
    assert answer.pose.pose == rig.tick(1)[0].message.pose.pose == Pose.planar(Pose2D(5.0))


GOOD = {
    "joint_states": [JointState(name=WHEEL_JOINTS, velocity=(1.0, 2.0, 3.0, 4.0))],
    "cmd_vel": [Twist.planar(Twist2D(0.1, 0.2, 0.3))],
}


@malformed(GOOD)
def test_malformed_payloads_change_nothing_for_the_run(wrong):
    rig = Controller(FOLLOWER_ACTIVE)
    rig.tick(0)
    rig.command(0, 0.1)
    rig.put_wrong(wrong)
    (odom,) = rig.tick(1, (2.0,) * 4)
    assert odom.message.pose.pose.to_planar() == (0.1 * 0.01, 0.0, 0.0)
    (command,) = rig.command(1, 0.2, 0.1, 0.5)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))


@forged(GOOD)
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(wrong):
    rig = Controller()
    rig.tick(0)
    for sample in rig.put_wrong(wrong):
        if sample.key == "joint_command":
            assert max(map(abs, sample.message.velocity)) <= 40.0
    odom, _ = rig.tick(0, run=NEXT_RUN)
    assert odom.message.pose.pose.to_planar() == Pose2D()
    rig.command(0, 0.2, 0.1, 0.5, run=NEXT_RUN)
    odom, command = rig.tick(1, (2.0,) * 4, run=NEXT_RUN)
    assert odom.message.pose.pose.to_planar() == (0.1 * 0.01, 0.0, 0.0)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))
