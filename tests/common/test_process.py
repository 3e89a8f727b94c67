"""Services and the router as processes: `python -m mecazen.runtime`."""

import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
import toys
from harness import COMMAND_GUARD_S, wait
from mecazen.config import BusConfig, Process
from mecazen.errors import BusError
from mecazen.runtime import process as running
from mecazen.wire import Stamp

SCENARIO = """services = ['mine']
[programs]
mine = '../my.py:Mine'
"""
PROMPT, BROKEN = "programs.mine=../my.py:Prompt", "programs.mine=../my.py:Broken"


@pytest.fixture
def settings(router):
    """Overrides by which processes meet at this test's router in a namespace of its own."""
    return (f'bus.connect=["{router}"]', f"bus.namespace=test{secrets.token_hex(6)}")


@pytest.fixture
def tester(settings, open_bus):
    """A bus of that namespace."""
    bus = open_bus(namespace=settings[1].partition("=")[2])
    bus.declare_alive("tester")
    return bus


@pytest.fixture
def start(write_scenario, tmp_path, settings):
    """Start `python -m mecazen.runtime`; it ends with the test."""
    shutil.copy(toys.__file__, tmp_path / "my.py")
    scenario = write_scenario(SCENARIO)

    @contextmanager
    def start(name, *further, before=()):
        flags = [f"--set={setting}" for setting in (*settings, *further)]
        with subprocess.Popen(
            [*before, sys.executable, "-m", "mecazen.runtime", name, str(scenario), *flags],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=scenario.parent,
        ) as process:
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
    """Return the line of a process that can't begin, and its exit code."""
    out, err = process.communicate(timeout=COMMAND_GUARD_S)
    assert out == ""
    assert len(err.splitlines()) == 1, err
    return err.rstrip(), process.returncode


@pytest.mark.parametrize(
    ("part", "number", "last"),
    [
        ("mine", signal.SIGTERM, "t=0.000 level=info service=mine msg=stopped\n"),
        ("router", signal.SIGHUP, ""),
    ],
)
def test_a_signal_ends_it_cleanly(start, free_port, part, number, last):
    place = [f'bus.connect=["tcp/127.0.0.1:{free_port}"]'] if part == "router" else []
    with start(part, *place) as process:
        started = rf"t=0\.000 level=info service={part} msg=started \S+\n"
        assert re.fullmatch(started, await_start(process))
        process.send_signal(number)
        out, err = process.communicate(timeout=COMMAND_GUARD_S)
    assert (process.returncode, out, err) == (0, "", last)


@pytest.fixture
def priority():
    """Skip where a process may have no real-time priority."""
    ask = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))"
    if subprocess.run([sys.executable, "-c", ask], capture_output=True, check=False).returncode:
        pytest.skip("needs root, or a limit of real-time priority (ulimit -r) of at least 2")


@pytest.mark.parametrize(
    ("setting", "policy", "shares_core"),
    [
        ("sim.mode=real_time", (os.SCHED_RR, 2), True),
        ("sim.speed=2.0", (os.SCHED_OTHER, 0), False),
        ("sim.mode=lockstep", (os.SCHED_BATCH, 0), True),
    ],
)
@pytest.mark.usefixtures("priority")
def test_threads_have_the_policy_and_the_core(start, setting, policy, shares_core):
    with start("mine", PROMPT, setting) as process:
        await_start(process)
        threads = [int(path.name) for path in Path(f"/proc/{process.pid}/task").iterdir()]
        policies = {
            (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority)
            for thread in threads
        }
        cores = {core for thread in threads for core in os.sched_getaffinity(thread)}
    assert len(threads) > 1
    assert policies == {policy}
    assert len(cores) == (1 if shares_core else len(os.sched_getaffinity(0)))


@pytest.mark.usefixtures("priority")
def test_a_service_works_without_permission_for_priority(start):
    drop = ["setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice"]
    with start("mine", PROMPT, before=drop) as process:
        await_start(process)
        assert os.sched_getscheduler(process.pid) == os.SCHED_OTHER


def test_a_service_logs_with_simulated_time(start, tester):
    with start("mine") as process:
        await_start(process)
        wait(tester, lambda: "mine" in tester.presence.names)
        tester.put_bytes("clock", b"{}", "", Stamp(1_500_000_000, 1, 2).pack())
        tester.put_bytes("cmd_vel", b"nonsense")
        line = process.stderr.readline()
    assert line.startswith("t=1.500 level=warning service=mine msg=refused key=cmd_vel count=1 ")


@pytest.mark.parametrize(
    ("name", "setting", "code", "expected"),
    [
        (
            "mine",
            BROKEN,
            1,
            r"mine: ZeroDivisionError: no seed \(my.py:\d+ reset\)$",
        ),
        ("mine+mine", "seed=1", 2, r"mine\+mine: each service at most once$"),
        ("router", "seed=1", 1, r"can't listen on tcp/\S+: the port is taken"),
    ],
)
def test_a_process_that_can_not_begin_prints_one_line(start, name, setting, code, expected):
    with start(name, setting) as process:
        line, exit_code = one_line(process)
    assert re.match(f"error: {expected}", line)
    assert exit_code == code


def test_each_service_of_a_process_has_its_name(start, tester):
    with start("mine+controller", "services=['mine','controller']") as process:
        assert "service=mine+controller msg=started" in await_start(process)
        names = {"mine", "controller", "controller/ready"}
        wait(tester, lambda: names <= tester.presence.names)
        with start("mine") as second:
            assert one_line(second) == ("error: another mine is already running on this bus", 1)


def test_a_missing_extra_for_ros_is_an_error(monkeypatch, scenario):
    monkeypatch.setattr(running, "is_installed", lambda extra: extra != "ros2")
    scenario = msgspec.structs.replace(scenario, bus=BusConfig(ros2=True))
    with pytest.raises(BusError, match=r"bus.ros2 needs pip install 'mecazen\[ros2\]'"):
        running.run(Process(("controller",)), scenario)
