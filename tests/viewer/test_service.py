"""Runs become recordings, wrong samples are refused, a run without a description has no robot."""

import logging
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from harness import error_of, load_robot
from hostile import forged
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.urdf import RobotDescription, serve_description
from mecazen.wire import Stamp, encode
from mecazen_tools.cli.view import view
from mecazen_viewer.service import draw
from viewer.drawing import Content
from viewer_stage import COVARIANCE, URDF, Stage


def test_each_run_is_a_separate_recording():
    stage = Stage()
    assert stage.shown == []
    stage.play(run=0xABC, ticks=3)
    stage.play(run=0xDEF, ticks=3)
    assert stage.shown == ["00000abc", "00000def"]


def test_late_samples_of_an_ended_run_begin_no_recording():
    stage = Stage()
    stage.play(run=1, ticks=2)
    stage.play(run=2, ticks=2)
    stage.play(run=1, ticks=2, begin=2)
    assert len(stage.shown) == 2


def test_unstamped_command_belongs_to_the_run_and_begins_none():
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
def test_missing_robot_description_is_one_line(caplog, robots, whose, key):
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
def test_pose_out_of_range_is_refused(robots, key):
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


@forged(GOOD)
def test_viewer_survives_hostile_samples(wrong):
    stage = Stage()
    assert "physics" in Scenario(robot=stage.viewer.scenario.robot).services
    for put in wrong:
        stage.bus.put_bytes(*put)
    stage.play(run=4711, ticks=1)
    assert stage.viewer.stamp.run == 4711


def recording_of(*samples: tuple[int, int | None]) -> SimpleNamespace:
    """A recording of the robot's poses at times [ms] of runs; None is before the first run."""

    def sample(ms: int, run: int | None) -> SimpleNamespace:
        stamp = None if run is None else Stamp(ms * 10**6, run, 3)
        odom = m.planar_odometry(m.Time(), "world", "base_link", Pose2D(), Twist2D())

        def publish() -> tuple[bytes, str, bytes | None]:
            decoded.append((ms, run))
            return encode(odom), "application/json", stamp and stamp.pack()

        return SimpleNamespace(
            key="ground_truth/odom", stamp=stamp, time_ns=ms * 10**6, as_published=publish
        )

    decoded: list[tuple[int, int | None]] = []
    return SimpleNamespace(
        path="run.mcap",
        decoded=decoded,
        samples=lambda: (sample(*row) for row in samples),
        descriptions=dict,
        scenario=lambda *_: Scenario(robot=load_robot()),
    )


def test_recorded_runs_become_files_at_the_frame_rate(tmp_path):
    ticks = [(10 * tick, 1) for tick in range(10)]
    recording = recording_of((0, None), *ticks, (0, 2))
    files = draw(recording, tmp_path)
    counts = [len(Content(file).all("world/robot", "Transform3D:translation")) for file in files]
    assert counts == [3, 1]  # 30 a second: every fourth of those each 10 ms
    assert recording.decoded == [(0, 1), (40, 1), (80, 1), (0, 2)]  # which takes the most time


def test_a_damaged_sample_is_reported_and_the_others_are_drawn(tmp_path, caplog):
    recording = recording_of((0, 1), (40, 1))
    damaged, good = recording.samples()
    damaged.as_published = Mock(side_effect=RefusedError("ends early"))
    recording.samples = lambda: iter((damaged, good))
    (file,) = draw(recording, tmp_path)
    assert len(Content(file).all("world/robot", "Transform3D:translation")) == 1
    assert "msg=refused key=ground_truth/odom count=1 reason='ends early'" in caplog.text


def test_files_that_are_not_recordings_are_refused(tmp_path):
    text = tmp_path / "text.mcap"
    text.write_text("hello")
    missing = tmp_path / "missing.rrd"
    for file, reason in ((text, "not an MCAP file"), (missing, "no such file")):
        assert error_of(ConfigError, lambda file=file: view(file)) == f"{file}: {reason}"
    empty = recording_of((0, None))
    assert error_of(ConfigError, lambda: draw(empty, tmp_path)) == "run.mcap: holds no run"
