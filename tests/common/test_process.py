"""Services as a process: how they end, and what they say when they can't begin."""

import json
import logging
import os
import re
import secrets
import signal
import subprocess
import sys
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from carts import Carts
from harness import COMMAND_GUARD_S, wait
from mecazen.bus import LocalBus
from mecazen.config import BusConfig, Process, SimConfig
from mecazen.errors import BusError
from mecazen.keys import SIM_STATE
from mecazen.messages import Empty
from mecazen.node import Node
from mecazen.runtime import process as running
from mecazen.runtime.clock import Clock
from mecazen.runtime.observer import Observer
from mecazen.runtime.report import Reporter
from mecazen.runtime.worker import Worker
from mecazen.wire import Stamp

TOYS = """
from mecazen.row import Row, due, every, latest
from mecazen.keys import CLOCK, CMD_VEL, GROUND_TRUTH, JOINT_STATES, TARGET_CMD_VEL
from mecazen.messages import JointState, Odometry, Twist
from mecazen.node import Node
from mecazen.runtime.observer import Observer


class Toy(Node):
    ROW = Row("toy", "", (every(CLOCK), latest(CMD_VEL)), (TARGET_CMD_VEL,))

    def reset(self, seed):
        pass

    def step(self, tick, inputs):
        return {TARGET_CMD_VEL: Twist()}


class Pal(Toy):
    ROW = Row("pal", "", (every(CLOCK),))

    def step(self, tick, inputs):
        return {}


class Prompt(Toy):
    ROW = Row("prompt", "", Toy.ROW.inputs, priority=2)


class Broken(Toy):
    def reset(self, seed):
        raise ZeroDivisionError("no seed is good enough")


class Still(Node):
    ROW = Row(
        "still",
        "",
        (every(CLOCK), due(TARGET_CMD_VEL, before=True)),
        (JOINT_STATES, GROUND_TRUTH),
    )

    def reset(self, seed):
        pass

    def step(self, tick, inputs):
        return {JOINT_STATES: JointState(), GROUND_TRUTH: Odometry()}


class Page(Observer):
    def reset(self, seed):
        pass

    def run(self):
        self.announce("http://127.0.0.1:1")
        super().run()
"""
SCENARIO = """services = ['toy']
[programs]
toy = '../toys.py:Toy'
"""
TWO_ROBOTS = 'robots=[{name="one"},{name="two",start={y_m=2.0}}]'


@pytest.fixture
def settings(router):
    """Overrides by which processes meet at this test's router in a namespace of its own."""
    return (f'bus.connect=["{router}"]', f"bus.namespace=test{secrets.token_hex(6)}")


@pytest.fixture
def places(settings, free_port):
    """The settings of each part: the router is another one."""
    return {"toy": settings, "router": [f'bus.connect=["tcp/127.0.0.1:{free_port}"]']}


@pytest.fixture
def tester(settings, open_bus):
    """A bus of that namespace."""
    bus = open_bus(namespace=settings[1].partition("=")[2])
    bus.declare_alive("tester")
    return bus


@pytest.fixture
def start(write_scenario, tmp_path):
    """Start `python -m mecazen.runtime`, and end it with the test."""
    (tmp_path / "toys.py").write_text(TOYS)
    scenario = write_scenario(SCENARIO)

    @contextmanager
    def start(name, settings, *options, before=(), pass_fds=()):
        process = subprocess.Popen(
            [
                *before,
                *(sys.executable, "-m", "mecazen.runtime", name, str(scenario)),
                *(f"--set={setting}" for setting in settings),
                *options,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            pass_fds=pass_fds,
            cwd=scenario.parent,
        )
        with process:
            try:
                yield process
            finally:
                process.kill()

    return start


def await_start(process):
    for line in process.stderr:
        if "msg=started" in line:
            return line
    pytest.fail("it ended before it had started")


def one_line(process):
    """Return the one line that a process which can't begin has to say, and its exit code."""
    out, err = process.communicate(timeout=COMMAND_GUARD_S)
    assert out == ""
    assert len(err.splitlines()) == 1, err
    return err.rstrip(), process.returncode


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.parametrize(
    ("part", "with_what", "last"),
    [
        ("toy", "mode=real_time", "t=0.000 level=info service=toy msg=stopped\n"),
        ("router", r"endpoints=\S+", ""),
    ],
)
def test_a_signal_ends_it_cleanly(start, places, part, with_what, last, number):
    with start(part, places[part]) as process:
        started = rf"t=0\.000 level=info service={part} msg=started {with_what}\n"
        assert re.fullmatch(started, await_start(process))
        process.send_signal(number)
        out, err = process.communicate(timeout=COMMAND_GUARD_S)
    assert (process.returncode, out, err) == (0, "", last)


@pytest.mark.parametrize("part", ["toy", "router"])
def test_when_standard_input_closes_expect_an_orphan_to_end(start, places, part):
    with start(part, places[part], "--until-orphaned") as process:
        await_start(process)
        process.communicate(timeout=COMMAND_GUARD_S)  # closes its standard input
    assert process.returncode == 0


@pytest.fixture
def priority():
    """Skip where a process may have no real-time priority."""
    ask = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))"
    if subprocess.run([sys.executable, "-c", ask], capture_output=True, check=False).returncode:
        pytest.skip("needs root, or a limit of real-time priority (ulimit -r) of at least 2")


@pytest.mark.parametrize(
    ("kind", "setting", "expected"),
    [
        ("Prompt", "sim.mode=real_time", (os.SCHED_RR, 2)),
        ("Prompt", "sim.speed=2.0", (os.SCHED_OTHER, 0)),
        ("Prompt", "sim.mode=lockstep", (os.SCHED_OTHER, 0)),
        ("Toy", "sim.mode=real_time", (os.SCHED_OTHER, 0)),
    ],
)
@pytest.mark.usefixtures("priority")
def test_in_real_time_all_threads_have_the_priority_of_the_row(
    start, settings, kind, setting, expected
):
    with start("toy", [*settings, setting, f"programs.toy=../toys.py:{kind}"]) as process:
        await_start(process)
        threads = [int(path.name) for path in Path(f"/proc/{process.pid}/task").iterdir()]
        found = {(os.sched_getscheduler(t), os.sched_getparam(t).sched_priority) for t in threads}
    assert len(threads) > 1
    assert found == {expected}


@pytest.mark.usefixtures("priority")
def test_where_priority_is_not_allowed_a_service_works_without(start, settings):
    drop = ["setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice"]
    prompt = "programs.toy=../toys.py:Prompt"
    with start("toy", [*settings, prompt], before=drop) as process:
        await_start(process)
        assert os.sched_getscheduler(process.pid) == os.SCHED_OTHER


def test_a_service_logs_with_simulated_time(start, settings, tester):
    with start("toy", settings) as process:
        await_start(process)
        wait(tester, lambda: "toy" in tester.presence.names)
        tester.put_bytes("clock", b"{}", "", Stamp(1_500_000_000, 1, 2).pack())
        tester.put_bytes("cmd_vel", b"nonsense")
        line = process.stderr.readline()
    assert line.startswith("t=1.500 level=warning service=toy msg=refused key=cmd_vel count=1 ")


@pytest.mark.parametrize(
    ("name", "setting", "code", "expected"),
    [
        ("nobody", "seed=1", 2, r"nobody: no such node; nodes: "),
        ("toy", "sim.speed=fast", 2, r".*test\.toml with --set sim\.speed: got 'fast'; allowed: "),
        ("toy+toy", "seed=1", 2, r"toy\+toy: each service at most once$"),
        ("router", "seed=-1", 2, r".*test\.toml with --set seed: got -1; allowed: "),
        ("router", 'bus.connect=["{router}"]', 1, "can't listen on {router}: the port is taken"),
        ("toy", TWO_ROBOTS, 2, r"toy: of which robot\? --robot takes one or two$"),
    ],
)
def test_when_it_can_not_begin_expect_one_line(start, router, name, setting, code, expected):
    with start(name, [setting.replace("{router}", router)]) as process:
        line, found = one_line(process)
    assert re.match(f"error: {expected.replace('{router}', router)}", line)
    assert found == code


def test_a_failing_node_is_told_with_its_place(start, settings):
    with start("toy", [*settings, "programs.toy=../toys.py:Broken"]) as process:
        line, code = one_line(process)
    assert re.fullmatch(
        r"error: toy: ZeroDivisionError: no seed is good enough \(toys.py:\d+ reset\)", line
    )
    assert code == 1


def test_services_of_one_process_are_there_each_by_its_name(start, settings, tester):
    settings = [*settings, "programs.pal=../toys.py:Pal"]
    with start("toy+pal", settings) as process:
        assert "service=toy+pal msg=started" in await_start(process)
        wait(tester, lambda: {"toy", "pal", "pal/ready"} <= tester.presence.names)
        with start("pal", settings) as second:
            line, code = one_line(second)
    assert (line, code) == ("error: another pal is already running on this bus", 1)


def test_in_one_process_with_the_clock_are_the_services_of_all_robots(start, settings, tester):
    world = ["programs.physics=../toys.py:Still", 'services=["physics","toy"]', TWO_ROBOTS]
    with start("physics+toy", [*settings, *world, "sim.mode=lockstep"]) as process:
        await_start(process)
        wait(tester, lambda: "physics" in tester.presence.names)
        # each tick is answered by both
        wait(tester, lambda: tester.call(SIM_STATE, Empty()).tick >= 4)


@pytest.mark.parametrize(
    ("name", "setting", "reports", "code"),
    [
        ("toy", "seed=1", [("started", "")], 0),
        ("viewer", "seed=1", [("started", ""), ("serving", "http://127.0.0.1:1")], 0),
        ("toy", "sim.tick_s=7", [("failed", "sim.tick_s")], 2),
    ],
)
def test_what_happens_is_reported_on_the_pipe_instead_of_the_log(
    start, settings, name, setting, reports, code
):
    heard, told = os.pipe()
    settings = [*settings, setting, "programs.viewer=../toys.py:Page"]
    with (
        start(name, settings, f"--report={told}", pass_fds=(told,)) as process,
        os.fdopen(heard) as lines,
    ):
        os.close(told)
        for kind, text in reports:
            report = json.loads(lines.readline())
            assert (report["kind"], text in report["text"]) == (kind, True)
        if code == 0:
            process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=COMMAND_GUARD_S)
        assert lines.read() == ""
    assert (process.returncode, err) == (code, "")


def test_a_missing_extra_for_ros_is_an_error_that_says_what_to_install(monkeypatch, scenario):
    monkeypatch.setattr(running, "is_installed", lambda extra: extra != "ros2")
    scenario = msgspec.structs.replace(scenario, bus=BusConfig(ros2=True))
    for start in (partial(running.run_process, Process(("controller",))), running.run_router):
        with pytest.raises(BusError, match=r"bus.ros2 needs pip install 'mecazen\[ros2\]'"):
            start(scenario, Reporter(None))


def test_a_client_waits_for_the_router_once(monkeypatch, scenario):
    opened = []

    def open_bus(*_, **__):
        opened.append(1)
        raise BusError("nothing answers")

    monkeypatch.setattr(running, "ZenohBus", open_bus)
    scenario = msgspec.structs.replace(scenario, bus=BusConfig(mode="client"))
    with pytest.raises(BusError, match="nothing answers"):
        running.run_process(Process(("controller",)), scenario, Reporter(None))
    assert opened == [1]


@pytest.mark.parametrize(
    ("others", "core"),
    [
        ([], 3),
        ([(7, {3})], 0),
        ([(7, {3}), (7, {0}), (8, {1}), (8, {1}), (9, {2})], 3),
        ([(7, {3}), (1, {2}), (7, {2})], 2),  # of its own stack
        ([(1, {0, 1, 2, 3}), (7, {3})], 0),  # it may run anywhere
        ([(1, {9})], 3),  # where this process may not run
    ],
)
def test_a_stack_stays_together_on_the_core_with_the_fewest_real_time_processes(others, core):
    assert running.choose_core([3, 0, 1, 2], others, parent=1) == core


class Page(Observer):
    def reset(self, seed):
        self.seed = seed


class Still(Node):
    def reset(self, seed): ...

    def step(self, tick, inputs):
        return {}


@pytest.fixture
def toys(monkeypatch):
    kinds = {"physics": Carts, "viewer": Page}
    monkeypatch.setattr("mecazen.programs.find", lambda name, _: kinds.get(name, Still))


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize(
    ("services", "kind"),
    [(["target"], Worker), (["physics"], Clock), (["target", "physics"], Clock)],
)
def test_with_the_world_there_is_time_and_without_it_a_worker_that_waits(scenario, services, kind):
    driver = running.drive([(service, "") for service in services], LocalBus(), scenario)
    assert type(driver) is kind
    assert {turn.row.name for turn in driver.host.loop.turns} == {
        *services,
        *(["clock"] if kind is Clock else []),
    }


@pytest.mark.usefixtures("toys")
def test_an_observer_drives_itself_and_has_begun_a_run(scenario):
    page = running.drive([("viewer", "")], LocalBus(), scenario)
    assert isinstance(page, Page)
    assert page.seed == 5


@pytest.fixture
def opened(monkeypatch):
    """The settings of sessions that were opened; handlers and logs are as before when it ends."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    opened = []

    def open_session(*args, **settings):
        opened.append(settings)
        return nullcontext()

    monkeypatch.setattr(running, "open_session", open_session)
    yield opened
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("sim", "most_hz"),
    [
        (SimConfig(), 1000.0),  # ten samples in each tick of 10 ms
        (SimConfig(tick_s=0.02, speed=4.0), 2000.0),
        (SimConfig(mode="lockstep"), None),
    ],
)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_even_if_it_comes_before_it_waits(opened, scenario, sim, most_hz, number):
    told = []

    def tell(report):
        told.append(report.kind)
        os.kill(os.getpid(), number)

    reporter = SimpleNamespace(log_level=logging.WARNING, tell=tell)
    running.run_router(msgspec.structs.replace(scenario, sim=sim), reporter)
    assert told == ["started"]
    assert opened == [{"most_hz": most_hz, "robots": ("",), "renamed": {}}]
