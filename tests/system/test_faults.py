"""Killed, frozen or slow parts and full disks: the others continue, and following resumes."""

import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import pytest
from faults import FREEZING, RESUME_S, SERVICES, WALK, Up, Watch, seconds, strike, strikes
from harness import ROOT, SCENARIOS, mecazen, tools
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.messages import Empty
from mecazen.wire import Stamp
from mecazen_recorder.reader import Recording
from mecazen_tools.processes import ProcessError

WATCHFUL = ROOT / "configs" / "zenoh" / "watchful.json5"
"""With a lease of 1 s instead of 10 s."""
CIRCLE = SCENARIOS / "circle.toml"
AT_REST_M_S = 0.02
"""Rollers that settle still move the body by less."""
STROLL_M_S = 0.3
"""A faster robot is on its way: the person walks at 0.5 m/s."""
REST_S = 5.0
"""A robot that looks for the person waits 2 s, and needs 1 s to stand; twice that is too much."""


class Running:
    """Services without a supervisor that restarts them, all of them following."""

    def __init__(self, stack: Callable[..., object], *settings: str) -> None:
        self.stack = stack(CIRCLE, *WALK, *settings)
        self.watch = Watch(self.stack.bus)
        self.stack.start()
        self.wait(lambda: self.watch.follows and self.watch.speed_m_s > STROLL_M_S)

    def wait(self, condition: Callable[[], bool]) -> None:
        self.stack.wait_unwatched(condition)

    def signal(self, name: str, number: int) -> None:
        os.kill(self.stack.supervisor.pids[name], number)

    def now(self) -> Stamp:
        return self.watch.stamp

    def wait_for_rest(self) -> None:
        begin = self.now()
        self.wait(lambda: self.watch.speed_m_s < AT_REST_M_S or seconds(begin, self.now()) > REST_S)
        assert self.watch.speed_m_s < AT_REST_M_S

    def wait_until_it_follows_again(self) -> None:
        begin = self.now()
        self.watch.following_since = None
        self.wait(lambda: self.watch.follows or seconds(begin, self.now()) > 2 * RESUME_S)
        since = self.watch.following_since
        assert since is not None, f"it does not follow again: {self.watch}"
        assert seconds(begin, since) <= RESUME_S
        self.watch.assert_sane()


@contextmanager
def frozen(running: Running, name: str) -> Iterator[None]:
    running.signal(name, signal.SIGSTOP)
    try:
        yield
    finally:
        running.signal(name, signal.SIGCONT)


@pytest.fixture
def running(stack):
    return Running(stack)


@pytest.mark.parametrize("name", ["controller", "target", "follower"])
def test_without_a_service_the_robot_rests_and_then_follows_again(running, name):
    running.signal(name, signal.SIGKILL)
    running.wait_for_rest()
    running.stack.launch(name)
    ready = f"{name}/ready"
    running.wait(lambda: ready in running.stack.bus.presence.names)
    running.wait_until_it_follows_again()
    assert running.stack.bus.presence.returns == {name: 1, ready: 1}
    if name in FREEZING:
        with frozen(running, name):
            running.wait_for_rest()
        running.wait_until_it_follows_again()


def test_a_physics_that_is_back_begins_a_run_in_which_the_robot_follows(running):
    before = running.now()
    running.stack.call(keys.SIM_PAUSE, Empty())
    running.signal("physics", signal.SIGKILL)
    running.wait(lambda: "physics" not in running.stack.bus.presence.names)
    running.stack.launch("physics")
    running.wait(lambda: running.now().run != before.run)
    assert running.now().time_ns < 10**9
    assert running.now().seed == before.seed
    running.wait_until_it_follows_again()
    assert not running.stack.call(keys.SIM_STATE, Empty()).paused


def test_without_the_router_the_robot_follows_on_and_with_it_tools_and_services_come_back(running):
    running.watch.begin_anew()
    begin = running.now()
    running.signal("router", signal.SIGKILL)
    running.wait(lambda: seconds(begin, running.now()) > 1.0)
    assert running.watch.follows
    with pytest.raises(ProcessError, match="router: was killed by SIGKILL"):
        running.stack.wait(lambda: False)
    running.stack.supervisor.start_router()
    tool = ZenohBus(running.stack.scenario.bus, "client")
    running.wait(lambda: set(SERVICES) <= tool.alive())
    assert tool.call(keys.SIM_STATE, Empty()).tick > 0
    tool.close()
    assert not running.stack.bus.presence.returns  # no service had gone
    running.signal("follower", signal.SIGKILL)
    running.wait(lambda: "follower" not in running.stack.bus.presence.names)
    running.stack.launch("follower")
    running.wait(lambda: "follower/ready" in running.stack.bus.presence.names)
    running.wait_until_it_follows_again()


def test_up_restarts_what_is_killed_alone_or_two_at_once():
    with Up("circle", *WALK) as up:
        up.wait_until_it_follows()
        for struck in (
            strike(up, ("physics", "router")),
            strike(up, ("controller", "follower")),
            *strikes(up, 3, seed=3),
        ):
            assert struck.in_time, struck
        status = mecazen(*tools(up.scenario.bus), "status", "--json")
        services = msgspec.json.decode(status.stdout)["services"]
        assert {name: service["state"] for name, service in services.items()} == {
            **dict.fromkeys(SERVICES, "ready"),
            "test": "alive",
        }
        returns = up.bus.presence.returns
        assert returns["controller"] >= 1
        # the service that was killed last counts from zero; a survivor has seen the others
        assert services["controller"]["restarts"] <= returns["controller"]


def test_while_physics_is_frozen_time_stands_still_and_then_it_goes_on(running):
    with frozen(running, "physics"):
        while running.stack.bus.spin_once(1.0):
            pass
        held = running.now()
    running.wait_until_it_follows_again()
    assert running.now().run == held.run


def test_a_service_that_is_frozen_for_longer_than_its_lease_is_counted_as_back(stack):
    # of two peers one may never hear of the other again: eclipse-zenoh/zenoh, issue 2806
    running = Running(stack, f"bus.zenoh_config={WATCHFUL}", "bus.mode=client")
    tokens = {"controller", "controller/ready"}
    with frozen(running, "controller"):
        running.wait(lambda: not tokens & running.stack.bus.presence.names)
    running.wait(lambda: tokens <= running.stack.bus.presence.names)
    running.wait_until_it_follows_again()
    assert running.stack.bus.presence.returns["controller"] == 1


SLOW = """
import time

from mecazen_follower.node import FollowerNode


class Slow(FollowerNode):
    def step(self, tick, inputs):
        time.sleep(0.05)  # five ticks long
        return super().step(tick, inputs)
"""


def test_a_slow_follower_costs_ticks_and_the_robot_follows(stack, tmp_path):
    (tmp_path / "slow.py").write_text(SLOW)
    running = Running(stack, f"programs.follower={tmp_path / 'slow.py'}:Slow")
    said = {}
    running.stack.bus.subscribe(
        keys.diagnostics("follower"),
        lambda report, _: said.update({v.key: v.value for v in report.status[0].values}),
    )
    running.wait(lambda: int(said.get("missed_ticks", 0)) > 100 and "hz/odom" in said)
    assert float(said["hz/odom"]) <= 21.0
    running.wait_until_it_follows_again()


FULL = 700_000
"""Bytes: what the robot looks like, and a second or two of a recording."""


def test_a_recorder_without_space_ends_with_what_it_has_and_the_rest_goes_on(tmp_path):
    file = tmp_path / "run.mcap"
    services = f"services={[*SERVICES, 'recorder']}"
    with Up("circle", *WALK, services, f"recorder.file={file}", restart=False) as up:
        up.wait_until_it_follows()
        recorder = up.pid("recorder")
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (FULL, FULL))
        up.wait(lambda: "recorder" not in up.bus.presence.names)
        begin = up.watch.stamp
        up.wait(lambda: seconds(begin, up.watch.stamp or begin) > 1.0)
        assert up.watch.follows
    assert 0 < file.stat().st_size <= FULL
    assert sum(1 for _ in Recording(file).samples()) > 0


def test_a_recorder_that_was_killed_goes_on_in_a_file_of_its_own(tmp_path):
    files = [tmp_path / name for name in ("run.mcap", "run-2.mcap")]
    services = f"services={[*SERVICES, 'recorder']}"
    with Up("circle", *WALK, services, f"recorder.file={files[0]}") as up:
        up.wait(lambda: up.watch.stamp is not None and up.watch.stamp.time_ns > 3e9)
        recorder = up.pid("recorder")
        os.kill(recorder, signal.SIGKILL)
        up.wait(lambda: up.bus.presence.returns["recorder/ready"] == 1)
        back = up.watch.stamp
        up.wait(lambda: seconds(back, up.watch.stamp or back) > 1.0)
    before, after = (
        [sample.time_ns for sample in Recording(file).samples() if sample.key == "clock"]
        for file in files
    )
    assert 0 < max(before) < min(after)


def test_a_simulation_that_can_not_be_recorded_is_an_error(tmp_path):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (FULL, FULL))

    file = tmp_path / "run.mcap"
    run = ("simulate", "circle", "--duration", 30, "--distributed", "--record", file)
    done = mecazen(*run, before=limit)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith("error: ")
    assert "can't be written on: File too large" in done.stderr
