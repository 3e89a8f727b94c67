"""Rerun as a child process: attaching at any time, ports, memory, and its end."""

import os
import select
import socket
import subprocess
import sys
import urllib.request
from contextlib import closing

import numpy as np
import psutil
import pytest
import rerun as rr
from harness import error_of
from mecazen.config import ViewerConfig
from mecazen_viewer.rerun_process import RerunError, RerunServer
from mecazen_viewer.service import MEMORY_LIMIT
from rerun.experimental import ViewerClient, ViewerState
from viewer_stage import Stage, paths_of

ANYWHERE = ViewerConfig(web_port=0, data_port=0)
GUARD = 200
"""Questions to a viewer that are answered one after the other: only a hang needs so many."""


def wait(viewer: ViewerClient, recordings: int) -> ViewerState:
    """The state of a viewer once it shows so many recordings, and all that they have."""
    for _ in range(GUARD):
        state = viewer.get_state()
        viewer.take_screenshot()  # which takes a frame, so this is no busy wait
        if len(state.recordings) == recordings and all(r.timelines for r in state.recordings):
            return state
    raise AssertionError(f"never {recordings} recordings: {state}")


def test_late_viewer_sees_all_robots_and_runs(attach):
    stage = Stage(robots=("one", "two"))
    with closing(RerunServer(ANYWHERE)) as server:
        stage.viewer.serve_at(server.uri)
        stage.play(run=1, ticks=150)
        stage.viewer.recording.flush(timeout_sec=10.0)
        attach.open(server.uri)
        state = wait(attach, 1)
        assert not any(view.reports for view in state.views)
        (timeline,) = state.recordings[0].timelines
        assert (timeline.name, timeline.start, timeline.end) == ("sim_time", 0, 1_490_000_000)
        paths = paths_of(attach, *state.recordings)
        for path in ("world/{}/robot/wheel", "world/{}/odom/estimate", "plots/{}/distance"):
            assert {f"/{path.format(robot)}" for robot in ("one", "two")} <= paths
        stage.play(run=2, ticks=50)
        stage.viewer.recording.flush(timeout_sec=10.0)
        assert wait(attach, 2).active_recording.endswith(":00000002")
        stage.viewer.end()


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


def test_invalid_address_is_named():
    with pytest.raises(RerunError, match="invalid value 'nowhere'"):
        RerunServer(ViewerConfig(listen="nowhere"))


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
    stage, kilobytes_100 = Stage(), np.zeros((8333, 3), dtype=np.float32)
    with closing(RerunServer(ANYWHERE, f"--server-memory-limit={MEMORY_LIMIT}")) as server:
        stage.viewer.serve_at(server.uri)
        stage.play(run=0, ticks=2)
        first = memory_mb(stage)
        for begin in range(0, 4000, 2):
            stage.play(run=1, ticks=2, begin=begin)
            stage.viewer.recording.log("much", rr.Points3D(kilobytes_100))
            if begin % 200 == 0:
                stage.viewer.recording.flush(timeout_sec=60.0)
        assert memory_mb(stage) - first < 120.0  # 200 MB were logged
        for run in range(2, 62):
            stage.play(run, ticks=2)
        assert memory_mb(stage) - first < 120.0  # a run leaves what of it never changes
        stage.viewer.end()
