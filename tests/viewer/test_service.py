"""Runs become recordings, wrong samples are refused, a run without a description has no robot."""

import logging
from types import SimpleNamespace

from harness import error_of, load_robot
from hostile import forged
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS
from mecazen.urdf import RobotDescription, serve_description
from mecazen.wire import Stamp, encode
from mecazen_tools.cli.view import view
from mecazen_viewer.service import draw
from viewer.drawing import Content, following, odometry, report
from viewer_stage import COVARIANCE, URDF, Stage

DAMAGED_MS = 200
POSE = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0, 2.0, 3.0)), COVARIANCE)
GOOD = {
    "ground_truth/odom": (odometry(Pose2D(1.0, 2.0, 3.0)),),
    "odom": (odometry(Pose2D(1.0, 2.0, 3.0)),),
    "target/odom": (odometry(Pose2D(1.0, 2.0, 3.0)),),
    "joint_states": (m.JointState(name=WHEEL_JOINTS, position=(1.0,) * 4, velocity=(1.0,) * 4),),
    "target/observation": (m.Observation(poses=(POSE,)),),
    "follower/state": (following(Pose2D(1.0), Pose2D(2.0)),),
    "guard/state": (m.GuardState(state="stop", reason="something is 0.30 m ahead"),),
    "cmd_vel": (m.Twist.planar(Twist2D(1.0, 2.0, 3.0)),),
    "diagnostics/physics": (report("physics", rtf="1"),),
}


def test_each_run_is_one_recording():
    stage = Stage()
    stage.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    assert stage.shown == []  # an unstamped command begins no run
    stage.play(run=0xABC, ticks=3)
    stage.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    stage.play(run=0xDEF, ticks=3)
    stage.play(run=0xABC, ticks=2, begin=3)
    assert stage.shown == ["00000abc", "00000def"]


def test_missing_robot_description_is_one_line(caplog):
    stage = Stage(described=False, robots=("one", "two"))
    serve_description(stage.bus, "one", RobotDescription(URDF, {}))
    with caplog.at_level(logging.WARNING):
        stage.play(run=1, ticks=20)
    assert [record.getMessage() for record in caplog.records] == [
        "msg='no picture of two: two/robot_description: nobody answers'"
    ]
    assert stage.memories[-1].num_msgs() > 0


@forged(GOOD, max_examples=40)
def test_viewer_survives_hostile_samples(wrong):
    stage = Stage()
    assert "physics" in Scenario(robot=stage.viewer.scenario.robot).services
    for put in wrong:
        stage.bus.put_bytes(*put)
    stage.play(run=4711, ticks=1)
    assert stage.viewer.stamp.run == 4711


def recording_of(*rows: tuple[int, int | None]) -> SimpleNamespace:
    """A recording of the robot's poses at times [ms] of runs; None is before the first run."""
    decoded: list[tuple[int, int | None]] = []

    def sample(ms: int, run: int | None) -> SimpleNamespace:
        stamp = None if run is None else Stamp(ms * 10**6, run, 3)

        def publish() -> tuple[bytes, str, bytes | None]:
            decoded.append((ms, run))
            if ms == DAMAGED_MS:
                raise RefusedError("ends early")
            return encode(odometry(Pose2D())), "application/json", stamp and stamp.pack()

        return SimpleNamespace(
            key="ground_truth/odom", stamp=stamp, time_ns=ms * 10**6, as_published=publish
        )

    return SimpleNamespace(
        path="run.mcap",
        decoded=decoded,
        samples=lambda: (sample(*row) for row in rows),
        descriptions=dict,
        scenario=lambda *_: Scenario(robot=load_robot()),
    )


def test_recorded_runs_become_files_at_the_frame_rate(tmp_path, caplog):
    ticks = [(10 * tick, 1) for tick in range(10)]
    recording = recording_of((0, None), *ticks, (DAMAGED_MS, 1), (0, 2))
    files = draw(recording, tmp_path)
    counts = [len(Content(file).all("world/robot", "Transform3D:translation")) for file in files]
    assert counts == [3, 1]  # 30 a second: every fourth of those each 10 ms
    # decoding takes the most time
    assert recording.decoded == [(0, 1), (40, 1), (80, 1), (DAMAGED_MS, 1), (0, 2)]
    assert "msg=refused key=ground_truth/odom count=1 reason='ends early'" in caplog.text


def test_files_that_are_not_recordings_are_refused(tmp_path):
    text = tmp_path / "text.mcap"
    text.write_text("hello")
    missing = tmp_path / "missing.rrd"
    for file, reason in ((text, "not an MCAP file"), (missing, "no such file")):
        assert error_of(ConfigError, lambda file=file: view(file)) == f"{file}: {reason}"
    empty = recording_of((0, None))
    assert error_of(ConfigError, lambda: draw(empty, tmp_path)) == "run.mcap: holds no run"
