"""Runs become recordings, and Rerun as a child process: attaching, ports, memory, and its end."""

import logging
import os
import select
import socket
import subprocess
import sys
import urllib.request
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import rerun as rr
from harness import error_of, load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import Bus
from mecazen.config import RobotConfig, Scenario, StartConfig, ViewerConfig
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.runtime.process import observe
from mecazen.urdf import RobotDescription, serve_description
from mecazen.wire import Stamp, encode
from mecazen_tools.cli.view import view
from mecazen_viewer.rerun_process import RerunError, RerunServer, headless_viewer
from mecazen_viewer.service import MEMORY_LIMIT, draw
from rerun.experimental import ViewerClient, ViewerState
from viewer.drawing import COVARIANCE, Content, following, odometry
from viewer.toy import URDF, stl

ANYWHERE = ViewerConfig(web_port=0, data_port=0)
GUARD = 200
"""Questions to a viewer that are answered one after the other: only a hang needs so many."""


MESH = stl(((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)))
DESCRIPTION = RobotDescription(URDF, {"meshes/r.stl": MESH})
POSE = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0, 2.0, 3.0)), COVARIANCE)


class Stage:
    """Publishes ticks of robots, each behind a person; its viewer keeps each run in memory."""

    def __init__(self, *robots: str, described: bool = True) -> None:
        self.bus = Bus()
        self.names = robots or ("",)
        for robot in self.names if described else ():
            serve_description(self.bus, robot, DESCRIPTION)
        members = tuple(
            RobotConfig(name=name, start=StartConfig(y_m=float(number)))
            for number, name in enumerate(robots)
        )
        self.viewer = observe("viewer", self.bus, Scenario(robot=load_robot(), robots=members))
        self.viewer.send = self._take
        self.shown: list[str] = []
        """The names of the recordings that it has begun."""
        self.memories: list[rr.MemoryRecording] = []

    def _take(self, recording: rr.RecordingStream) -> None:
        self.shown.append(recording.get_recording_id())
        self.memories.append(recording.memory_recording())

    def play(self, run: int, ticks: int, begin: int = 0) -> None:
        """Publish ticks of a run, one after the other."""
        for tick in range(begin, begin + ticks):
            stamp, robot = Stamp(tick * 10**7, run, 7), Pose2D(0.004 * tick)
            said = {
                keys.GROUND_TRUTH: odometry(robot),
                keys.JOINT_STATES: m.JointState(name=("wheel_joint",), position=(0.1 * tick,)),
                keys.TARGET_ODOM: odometry(robot.compose(Pose2D(1.0))),
                keys.OBSERVATION: m.Observation(m.Header(stamp.time, "base_link"), (POSE,)),
                keys.ODOM: odometry(robot),
                keys.FOLLOWER_STATE: following(robot.compose(Pose2D(1.0)), robot),
                keys.CMD_VEL: m.Twist.planar(Twist2D(0.4)),
            }
            for name in self.names:
                for topic, message in said.items():
                    self.bus.publisher(keys.of_robot(topic, name)).put(message, stamp)


@pytest.fixture
def attach():
    """A native viewer without a window: Rerun's `ViewerClient`."""
    try:
        with headless_viewer(1280, 720) as viewer:
            yield viewer
    except RerunError as error:
        pytest.skip(f"no viewer without a driver for Vulkan (mesa-vulkan-drivers): {error}")


def wait(viewer: ViewerClient, recordings: int, end_ns: int) -> ViewerState:
    """The state of a viewer once it shows a number of recordings, the last one up to a time."""
    for _ in range(GUARD):
        state = viewer.get_state()
        viewer.take_screenshot()  # which takes a frame, so this is no busy wait
        ends = [timeline.end for shown in state.recordings for timeline in shown.timelines]
        if len(state.recordings) == len(ends) == recordings and end_ns in ends:
            return state
    raise AssertionError(f"never {recordings} recordings: {state}")


def test_late_viewer_sees_all_robots_and_runs(attach):
    stage = Stage("one", "two")
    with closing(RerunServer(ANYWHERE)) as server:
        stage.viewer.serve_at(server.uri)
        stage.play(run=1, ticks=150)
        stage.viewer.recording.flush(timeout_sec=10.0)
        attach.open(server.uri)
        state = wait(attach, 1, end_ns=1_490_000_000)
        assert not any(view.reports for view in state.views)
        (timeline,) = state.recordings[0].timelines
        assert (timeline.name, timeline.start) == ("sim_time", 0)
        schema = attach.get_recording_schema(state.recordings[0].store_id, paths_only=True)
        paths = {entity.entity_path for entity in schema.entities}
        for path in ("world/{}/robot/wheel", "world/{}/odom/estimate", "plots/{}/distance"):
            assert {f"/{path.format(robot)}" for robot in ("one", "two")} <= paths
        stage.play(run=2, ticks=50)
        stage.viewer.recording.flush(timeout_sec=10.0)
        assert wait(attach, 2, end_ns=490_000_000).active_recording.endswith(":00000002")
        stage.viewer.close()


def test_page_and_data_are_served_on_loopback_only():
    with closing(RerunServer(ANYWHERE)) as server:
        with urllib.request.urlopen(server.url, timeout=10.0) as page:  # noqa: S310
            assert b"Rerun" in page.read()
        rerun = psutil.Process(server.pid)
        listening = [c for c in rerun.net_connections() if c.status == psutil.CONN_LISTEN]
        assert len(listening) == 2
        assert {connection.laddr.ip for connection in listening} == {"127.0.0.1"}


@pytest.mark.parametrize("key", ["web_port", "data_port"])
def test_taken_port_is_named_in_one_line(key):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        config = ViewerConfig(**{"web_port": 0, "data_port": 0, key: port})
        error = error_of(RerunError, lambda: RerunServer(config))
    assert error.startswith(f"viewer.{key} = {port}: address already in use")


def test_killed_server_is_one_line():
    stage = Stage()
    with closing(RerunServer(ANYWHERE)) as server:
        stage.viewer.serve_at(server.uri)
        stage.play(run=1, ticks=1)
        stage.viewer.recording.flush(timeout_sec=10.0)
        server.check()
        rerun = psutil.Process(server.pid)
        rerun.kill()
        rerun.wait()
        with pytest.raises(RerunError, match="rerun has ended"):
            server.check()
        stage.viewer.reset(seed=2)
        other = Stage()
        other.play(run=1, ticks=1)
        assert other.shown == ["00000001"]


def test_server_ends_when_the_viewer_is_killed():
    code = (
        "from mecazen.config import ViewerConfig\n"
        "from mecazen_viewer.rerun_process import RerunServer\n"
        "import sys\n"
        "print(RerunServer(ViewerConfig(web_port=0, data_port=0)).pid, flush=True)\n"
        "sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as viewer:
        server = os.pidfd_open(int(viewer.stdout.readline()))
        viewer.kill()
        assert select.select([server], [], [], 60.0)[0]
        os.close(server)


def memory_mb(stage: Stage) -> float:
    """Memory of this process and its server, once they have all data."""
    stage.viewer.recording.flush(timeout_sec=60.0)
    me = psutil.Process()
    return sum(process.memory_info().rss for process in (me, *me.children())) / 1e6


def test_memory_is_bounded_over_long_and_many_runs():
    stage, megabyte = Stage(), np.zeros((83_333, 3), dtype=np.float32)
    with closing(RerunServer(ANYWHERE, f"--server-memory-limit={MEMORY_LIMIT}")) as server:
        stage.viewer.serve_at(server.uri)
        stage.play(run=0, ticks=2)
        first = memory_mb(stage)
        for begin in range(0, 400, 2):
            stage.play(run=1, ticks=2, begin=begin)
            stage.viewer.recording.log("much", rr.Points3D(megabyte))
            if begin % 20 == 0:
                stage.viewer.recording.flush(timeout_sec=60.0)
        assert memory_mb(stage) - first < 120.0  # 200 MB were logged
        for run in range(2, 62):
            stage.play(run, ticks=2)
        assert memory_mb(stage) - first < 120.0  # a run leaves what of it never changes
        stage.viewer.close()


DAMAGED_MS = 200


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
    stage = Stage("one", "two", described=False)
    serve_description(stage.bus, "one", DESCRIPTION)
    with caplog.at_level(logging.WARNING):
        stage.play(run=1, ticks=20)
    assert [record.getMessage() for record in caplog.records] == [
        "msg='no picture of two: two/robot_description: nobody answers'"
    ]
    assert stage.memories[-1].num_msgs() > 0


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
