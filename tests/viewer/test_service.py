"""Runs become recordings, wrong samples are refused, a run without a description has no robot."""

import logging

import pytest
from hostile import FORGED, FUZZ, puts
from hypothesis import given
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.geometry import Pose2D, Twist2D
from mecazen.urdf import RobotDescription, serve_description
from mecazen.wire import Stamp
from viewer_stage import COVARIANCE, URDF, Stage


def test_each_run_is_a_recording_of_its_own_that_begins_with_its_first_sample():
    stage = Stage()
    assert stage.shown == []
    stage.play(run=0xABC, ticks=3)
    stage.play(run=0xDEF, ticks=3)
    assert stage.shown == ["00000abc", "00000def"]


def test_what_is_late_of_an_ended_run_begins_no_recording():
    stage = Stage()
    stage.play(run=1, ticks=2)
    stage.play(run=2, ticks=2)
    stage.play(run=1, ticks=2, begin=2)
    assert len(stage.shown) == 2


def test_a_command_of_an_outsider_belongs_to_the_run_and_begins_none():
    stage = Stage()
    stage.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    assert stage.shown == []
    stage.play(run=5, ticks=1)
    stage.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    assert len(stage.shown) == 1


@pytest.mark.parametrize(
    ("robots", "whose", "key"),
    [((), "the robot", "robot_description"), (("one", "two"), "two", "two/robot_description")],
    ids=["one", "several"],
)
def test_without_a_description_the_rest_is_shown_and_one_line_says_of_which_robot(
    caplog, robots, whose, key
):
    stage = Stage(described=False, robots=robots)
    for robot in robots[:-1]:
        serve_description(stage.bus, robot, RobotDescription(URDF, {}))
    with caplog.at_level(logging.WARNING):
        stage.play(run=1, ticks=20)
    assert [record.getMessage() for record in caplog.records] == [
        f"msg='no picture of {whose}: {key}: nobody answers'"
    ]
    assert stage.memories[-1].num_msgs() > 0


@pytest.mark.parametrize(
    ("robots", "key"),
    [((), "ground_truth/odom"), (("one", "two"), "two/ground_truth/odom")],
    ids=["one robot", "several robots"],
)
def test_a_pose_that_can_not_be_drawn_is_refused_and_the_next_is_shown_in_the_same_recording(
    robots, key
):
    stage = Stage(robots=robots)
    stage.play(run=1, ticks=1)
    far = m.planar_odometry(m.Time(), "world", "base_link", Pose2D(1e9), Twist2D())
    topic = keys.of_robot(keys.GROUND_TRUTH, stage.names[-1])
    stage.bus.publisher(topic).put(far, Stamp(10**9, 1, 7))
    assert stage.bus.refused == {key: 1}
    stage.play(run=1, ticks=1, begin=101)
    assert stage.bus.refused.total() == 1
    assert stage.shown == ["00000001"]


POSE = m.PoseWithCovariance(pose=m.Pose.planar(Pose2D(1.0, 2.0, 3.0)), covariance=COVARIANCE)
GOOD = {
    "ground_truth/odom": (m.Odometry(pose=POSE),),
    "odom": (m.Odometry(pose=POSE),),
    "target/odom": (m.Odometry(pose=POSE),),
    "joint_states": (
        m.JointState(name=("front_left_wheel_joint",), position=(1.0,), velocity=(1.0,) * 4),
    ),
    "target/observation": (m.Observation(poses=(POSE,)),),
    "follower/state": (m.FollowerState(estimate=(m.Odometry(pose=POSE),), goal=(POSE.pose,)),),
    "guard/state": (m.GuardState(state="stop", reason="something is 0.30 m ahead"),),
    "cmd_vel": (m.Twist.planar(Twist2D(1.0, 2.0, 3.0)),),
    "diagnostics/physics": (
        m.DiagnosticArray(
            status=(m.DiagnosticStatus(name="physics", values=(m.KeyValue(key="rtf", value="1"),)),)
        ),
    ),
}


@FUZZ
@given(wrong=puts(GOOD, FORGED))
def test_whatever_comes_the_viewer_goes_on(wrong):
    stage = Stage()
    assert "physics" in Scenario(robot=stage.viewer.scenario.robot).services
    for put in wrong:
        stage.bus.put_bytes(*put)
    stage.play(run=4711, ticks=1)
    assert stage.viewer.stamp.run == 4711
