"""A service as a process: how it is found, how it ends, and what it says when it can't begin."""

import os
import re
import secrets
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from mecazen import runtime
from mecazen.errors import BusError, ConfigError
from mecazen.loading import load_scenario
from mecazen.runtime import exit_with, find_service
from mecazen.service import Service

GUARD_S = 60.0
"""Only ends a test that would hang."""

TOY = """
from mecazen import keys
from mecazen.service import Service


class Toy(Service):
    NAME = "toy"

    def __init__(self, bus, scenario):
        super().__init__(bus, scenario)
        self.subscribe(keys.CLOCK, lambda clock, stamp: None)
        self.subscribe(keys.CMD_VEL, lambda twist, stamp: None)

    def reset(self, seed):
        pass


class Prompt(Toy):
    NAME = "prompt"
    PRIORITY = 2


class Broken(Toy):
    NAME = "broken"

    def reset(self, seed):
        raise ZeroDivisionError("no seed is good enough")


NOT_A_CLASS = 3
"""


@pytest.fixture
def toy_file(tmp_path):
    file = tmp_path / "toy.py"
    file.write_text(TOY)
    return file


@pytest.fixture
def settings(router):
    """Overrides by which processes meet at this test's router in a namespace of its own."""
    return (f'bus.connect=["{router}"]', f"bus.namespace=test{secrets.token_hex(6)}")


@pytest.fixture
def start(write_scenario):
    """Start `python -m mecazen.runtime`, and end it with the test."""
    scenario = write_scenario("services = ['toy']\n")

    @contextmanager
    def start(name, settings, *options, before=()):
        process = subprocess.Popen(
            [
                *before,
                *(sys.executable, "-m", "mecazen.runtime", str(name), str(scenario)),
                *(f"--set={setting}" for setting in settings),
                *options,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
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
    out, err = process.communicate(timeout=GUARD_S)
    assert out == ""
    assert len(err.splitlines()) == 1, err
    return err.rstrip(), process.returncode


def test_when_a_service_is_unknown_expect_those_installed(scenario, monkeypatch):
    monkeypatch.setattr(runtime, "installed_services", lambda: ["controller", "physics"])
    with pytest.raises(ConfigError) as caught:
        find_service("physic", scenario)
    assert str(caught.value) == (
        "physic: no such service; installed: controller, physics; or file.py:Class of your own"
    )


def test_when_none_is_installed_expect_that_said(scenario, monkeypatch):
    monkeypatch.setattr(runtime, "installed_services", list)
    with pytest.raises(ConfigError, match="installed: none; or"):
        find_service("nobody", scenario)


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("none.py:Toy", "none.py: can't be imported: .*No such file"),
        ("wrong.py:Toy", r"wrong.py: can't be imported: .*\(wrong.py, line 1\)"),
        ("needs.py:Toy", "needs.py: can't be imported: No module named 'not_there'"),
        ("folder.py:Toy", "folder.py: can't be imported: "),
        ("toy.py:None", "toy.py:None: not a subclass of mecazen.service.Service"),
        ("toy.py:NOT_A_CLASS", "toy.py:NOT_A_CLASS: not a subclass of mecazen.service.Service"),
        ("toy.py:", "toy.py:: not a subclass of mecazen.service.Service"),
        ("not_there:Toy", "not_there: can't be imported: No module named 'not_there'"),
        ("json:JSONDecoder", "json:JSONDecoder: not a subclass of mecazen.service.Service"),
        (":Toy", "'': neither file.py nor a module's name"),
        ("..toy:Toy", "..toy: neither file.py nor a module's name"),
    ],
)
@pytest.mark.usefixtures("toy_file")
def test_when_a_class_of_ones_own_is_none_expect_one_line(
    tmp_path, scenario, monkeypatch, program, expected
):
    (tmp_path / "wrong.py").write_text("class Toy(")
    (tmp_path / "needs.py").write_text("import not_there")
    (tmp_path / "folder.py").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=f"^{expected}") as caught:
        find_service(program, scenario)
    assert len(str(caught.value).splitlines()) == 1


def test_a_class_of_ones_own_is_found_directly_and_in_a_parts_place(write_scenario, toy_file):
    path = write_scenario("[programs]\nfollower = '../toy.py:Toy'")
    for name in ("follower", f"{toy_file}:Toy"):
        found = find_service(name, load_scenario(path))
        assert issubclass(found, Service)
        assert found.NAME == "toy"


@pytest.mark.parametrize(("error", "code"), [(ConfigError, 2), (BusError, 1)])
def test_exit_with_prints_one_line_and_ends_with_the_errors_code(capsys, error, code):
    def fail():
        raise error("what is wrong")

    with pytest.raises(SystemExit) as caught:
        exit_with(fail)
    assert caught.value.code == code
    assert capsys.readouterr() == ("", "error: what is wrong\n")


def test_exit_with_when_nothing_is_wrong_returns():
    assert exit_with(lambda: None) is None


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_a_service_cleanly(start, toy_file, settings, number):
    with start(f"{toy_file}:Toy", settings) as process:
        line = await_start(process)
        assert line == "t=0.000 level=info service=toy msg=started mode=real_time\n"
        process.send_signal(number)
        out, err = process.communicate(timeout=GUARD_S)
    assert process.returncode == 0
    assert out == ""
    assert err == "t=0.000 level=info service=toy msg=stopped\n"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_router_cleanly(start, free_port, number):
    with start("router", [f'bus.connect=["tcp/127.0.0.1:{free_port}"]']) as process:
        assert re.fullmatch(
            r"t=0\.000 level=info service=router msg=started endpoints=\S+\n",
            await_start(process),
        )
        process.send_signal(number)
        _, err = process.communicate(timeout=GUARD_S)
    assert process.returncode == 0
    assert err == ""


@pytest.fixture
def precedence():
    """Skip where a process may not go before all others."""
    ask = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))"
    if subprocess.run([sys.executable, "-c", ask], capture_output=True, check=False).returncode:
        pytest.skip("needs root, or a limit of real-time priority (ulimit -r) of at least 2")


@pytest.mark.parametrize(
    ("name", "setting", "expected"),
    [
        ("Prompt", "sim.mode=real_time", (os.SCHED_RR, 2)),
        ("Prompt", "sim.speed=2.0", (os.SCHED_OTHER, 0)),
        ("Prompt", "sim.mode=lockstep", (os.SCHED_OTHER, 0)),
        ("Toy", "sim.mode=real_time", (os.SCHED_OTHER, 0)),
    ],
)
@pytest.mark.usefixtures("precedence")
def test_in_real_time_all_threads_of_what_works_briefly_go_before_others(
    start, toy_file, settings, name, setting, expected
):
    with start(f"{toy_file}:{name}", [*settings, setting]) as process:
        await_start(process)
        threads = [int(path.name) for path in Path(f"/proc/{process.pid}/task").iterdir()]
        found = {(os.sched_getscheduler(t), os.sched_getparam(t).sched_priority) for t in threads}
    assert len(threads) > 1
    assert found == {expected}


def test_where_precedence_is_not_allowed_a_service_works_without(
    start, toy_file, settings, precedence
):
    drop = ["setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice"]
    with start(f"{toy_file}:Prompt", settings, before=drop) as process:
        await_start(process)
        assert os.sched_getscheduler(process.pid) == os.SCHED_OTHER


def test_a_service_logs_with_simulated_time(start, toy_file, settings, open_bus, wait_until):
    namespace = settings[1].partition("=")[2]
    bus = open_bus(namespace=namespace)
    bus.declare_alive("tester")
    with start(f"{toy_file}:Toy", settings) as process:
        await_start(process)
        wait_until(bus, lambda: "toy" in bus.presence.names)
        # a stamp of 1.5 s, in run 1 with seed 2
        stamp = (1_500_000_000).to_bytes(8, "little") + bytes([1, 0, 0, 0, 2, 0, 0, 0])
        bus.put_bytes("clock", b"{}", "", stamp)
        bus.put_bytes("cmd_vel", b"nonsense")
        line = process.stderr.readline()
    assert line.startswith("t=1.500 level=warning service=toy msg=refused key=cmd_vel count=1 ")


def test_when_its_name_is_taken_expect_one_line(start, toy_file, settings):
    with start(f"{toy_file}:Toy", settings) as first:
        await_start(first)
        with start(f"{toy_file}:Toy", settings) as second:
            line, code = one_line(second)
    assert (line, code) == ("error: another toy is already running on this bus", 1)


def test_when_the_routers_port_is_taken_expect_one_line(start, router):
    with start("router", [f'bus.connect=["{router}"]']) as process:
        line, code = one_line(process)
    assert line.startswith(f"error: can't listen on {router}: the port is taken")
    assert code == 1


def test_when_there_is_no_such_service_expect_one_line(start):
    with start("nobody", []) as process:
        line, code = one_line(process)
    assert line.startswith("error: nobody: no such service; installed: ")
    assert code == 2


def test_when_a_setting_is_wrong_expect_one_line(start, toy_file):
    with start(f"{toy_file}:Toy", ["sim.speed=fast"]) as process:
        line, code = one_line(process)
    assert re.match(r"error: .*test\.toml with --set sim\.speed: got 'fast'; allowed: ", line)
    assert code == 2


def test_a_failing_service_shows_where_it_failed(start, toy_file, settings):
    with start(f"{toy_file}:Broken", settings) as process:
        _, err = process.communicate(timeout=GUARD_S)
    assert process.returncode == 1
    assert err.endswith("ZeroDivisionError: no seed is good enough\n")


@pytest.mark.parametrize("part", ["toy", "router"])
def test_when_standard_input_closes_expect_an_orphan_to_end(
    start, toy_file, settings, free_port, part
):
    if part == "router":
        settings = (f'bus.connect=["tcp/127.0.0.1:{free_port}"]',)
    name = "router" if part == "router" else f"{toy_file}:Toy"
    with start(name, settings, "--until-orphaned") as process:
        await_start(process)
        process.communicate(timeout=GUARD_S)  # closes its standard input
    assert process.returncode == 0


def test_who_waits_for_others_is_ready_when_all_are_alive(
    start, toy_file, settings, open_bus, wait_until
):
    bus = open_bus(namespace=settings[1].partition("=")[2])
    bus.declare_alive("tester")
    with start(f"{toy_file}:Toy", [*settings, 'services=["toy","other"]']) as process:
        await_start(process)
        wait_until(bus, lambda: "toy" in bus.presence.names)
        assert "toy/ready" not in bus.presence.names
        bus.declare_alive("other")
        wait_until(bus, lambda: "toy/ready" in bus.presence.names)


@pytest.mark.parametrize(("mode", "waits"), [("real_time", False), ("lockstep", True)])
def test_onlookers_are_waited_for_in_lockstep_alone(
    start, toy_file, settings, open_bus, wait_until, mode, waits
):
    bus = open_bus(namespace=settings[1].partition("=")[2])
    bus.declare_alive("tester")
    services = ['services=["toy","recorder","viewer"]', f"sim.mode={mode}"]
    with start(f"{toy_file}:Toy", [*settings, *services]) as process:
        await_start(process)
        wait_until(bus, lambda: "toy" in bus.presence.names)
        if waits:
            assert "toy/ready" not in bus.presence.names
            bus.declare_alive("recorder")
            bus.declare_alive("viewer")
        wait_until(bus, lambda: "toy/ready" in bus.presence.names)
