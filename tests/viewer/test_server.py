"""The server: attaching at any time, ports, memory, and its end."""

import subprocess
import sys
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from mecazen.config import ViewerConfig
from mecazen_viewer.layout import blueprint
from mecazen_viewer.server import Server, serving
from rerun.experimental import ViewerClient, ViewerState
from viewer_stage import Stage, paths_of

ANYWHERE = ViewerConfig(web_port=0, data_port=0)
LAYOUT = blueprint(("",))
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


@contextmanager
def playing(*robots: str, ticks: int = 50) -> Iterator[tuple[Server, Callable[[int], None]]]:
    """A server that shows run 1, and what plays another run."""
    stage = Stage(robots=robots)
    with serving(ANYWHERE, blueprint(robots or ("",))) as server:

        def play(run: int) -> None:
            stage.viewer.send = server.take
            stage.play(run, ticks)
            stage.viewer.recording.flush(timeout_sec=10.0)

        play(1)
        yield server, play
        stage.viewer.end()


def test_who_attaches_late_sees_the_whole_scene_and_the_past(attach):
    with playing() as (server, _):
        attach.open(server.uri)
        (recording,) = wait(attach, 1).recordings
        (timeline,) = recording.timelines
        assert (timeline.name, timeline.start, timeline.end) == ("sim_time", 0, 490_000_000)
        assert {
            "/world/ground",
            "/world/robot/base_link",
            "/world/robot",
            "/world/robot/wheel",
            "/world/person/arrow",
            "/world/observation",
            "/world/odom/estimate",
            "/world/odom/goal",
            "/world/trails/robot",
            "/plots/distance",
            "/log/follower",
        } <= paths_of(attach, recording)


def test_a_new_run_is_a_new_recording_in_the_viewer_that_is_attached(attach):
    with playing() as (server, play):
        attach.open(server.uri)
        assert wait(attach, 1).active_recording == "Recording:mecazen:00000001"
        play(2)
        assert wait(attach, 2).active_recording == "Recording:mecazen:00000002"


def test_two_robots_are_in_one_scene_and_no_view_of_either_complains(attach):
    with playing("one", "two", ticks=150) as (server, _):
        attach.open(server.uri)
        state = wait(attach, 1)
        assert not any(view.reports for view in state.views)
        views = Counter(view.name for view in state.views)
        assert (views["following"], views["distance error [m]"]) == (2, 2)
        paths = paths_of(attach, *state.recordings)
        for what in ("world/{}/robot/wheel", "world/{}/odom/estimate", "plots/{}/distance"):
            assert {f"/{what.format(robot)}" for robot in ("one", "two")} <= paths


def test_the_page_is_served_on_loopback_and_only_there():
    with serving(ANYWHERE, LAYOUT) as server:
        with urllib.request.urlopen(server.url, timeout=10.0) as answer:  # noqa: S310
            assert b"Rerun" in answer.read()
        (rerun,) = psutil.Process().children()
        listening = [c for c in rerun.net_connections() if c.status == psutil.CONN_LISTEN]
        assert len(listening) == 2
        assert {connection.laddr.ip for connection in listening} == {"127.0.0.1"}


def test_a_viewer_whose_server_has_died_survives_a_reset_and_so_do_others():
    stage = Stage()
    with serving(ANYWHERE, LAYOUT) as server:
        stage.viewer.send = server.take
        stage.play(run=1, ticks=1)
        held = stage.viewer.recording
        held.flush(timeout_sec=10.0)
        (rerun,) = psutil.Process().children()
        rerun.kill()
        rerun.wait()
        stage.viewer.reset(seed=2)
        other = Stage()
        other.play(run=1, ticks=1)
        assert other.shown == ["00000001"]
        with pytest.raises(RuntimeError):
            held.flush(timeout_sec=10.0)


MEMORY = """
import numpy as np
import psutil
import rerun as rr
from mecazen.config import ViewerConfig
from mecazen_viewer.layout import blueprint
from mecazen_viewer.server import serving
from viewer_stage import Stage

stage, me = Stage(), psutil.Process()
kilobytes_100 = np.zeros((8333, 3), dtype=np.float32)

def tell():
    stage.viewer.recording.flush(timeout_sec=60.0)
    memory = sum(process.memory_info().rss for process in (me, *me.children())) / 1e6
    print(memory, me.num_threads(), flush=True)

with serving(ViewerConfig(web_port=0, data_port=0), blueprint([""])) as server:
    stage.viewer.send = server.take
    for begin in range(0, 4000, 2):
        stage.play(run=1, ticks=2, begin=begin)
        stage.viewer.recording.log("much", rr.Points3D(kilobytes_100))
        if begin % 200 == 0:
            stage.viewer.recording.flush(timeout_sec=60.0)
    tell()
    for run in range(2, 62):
        stage.play(run, ticks=2)
    tell()
    stage.viewer.end()
"""


def test_memory_is_bounded_however_long_a_run_and_however_many_there_are():
    told = subprocess.run(
        [sys.executable, "-c", MEMORY],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
        cwd=Path(__file__).parents[1],
    ).stdout
    (long, threads), (many, in_the_end) = (map(float, line.split()) for line in told.splitlines())
    # 200 MB were logged, and programs alone take 180 MB: without a bound it were 380
    assert long < 300.0
    # a run leaves what of it never changes, and no thread
    assert many < 300.0
    assert in_the_end <= threads
