"""The supervisor starts processes, passes on the error of one that fails, and ends all."""

import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mecazen_tools import processes
from mecazen_tools.processes import Line, ProcessError, Supervisor

GUARD_S = 60.0
"""Only ends a test that would hang."""

TOY = """
import signal, sys
from pathlib import Path

from mecazen.errors import BusError
from mecazen.service import Service


class Toy(Service):
    NAME = "toy"

    def reset(self, seed):
        pass


class Fails(Toy):
    NAME = "fails"

    def reset(self, seed):
        raise BusError("the wheel came off")


class Crashes(Toy):
    NAME = "crashes"

    def reset(self, seed):
        raise ZeroDivisionError("twice")


class Works_First(Toy):
    NAME = "works_first"

    def reset(self, seed):
        mark = Path(__file__).with_suffix(".mark")
        if mark.exists():
            raise BusError("no second time")
        mark.touch()


class Quits(Toy):
    NAME = "quits"

    def reset(self, seed):
        sys.exit(7)


class Deaf(Toy):
    NAME = "deaf"

    def run(self):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        sys.stderr.write("deaf now\\n")
        sys.stderr.flush()
        while True:
            signal.pause()
"""


@pytest.fixture
def make_supervisor(write_scenario, tmp_path, router):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(
        "services = []\n[programs]\n"
        + "".join(
            f"{name} = '../toy.py:{name.title()}'\n"
            for name in ("toy", "fails", "crashes", "quits", "deaf", "works_first")
        )
    )
    namespace = f"test{secrets.token_hex(6)}"
    made = []

    def make(**options):
        settings = [f'bus.connect=["{router}"]', f"bus.namespace={namespace}"]
        made.append(Supervisor(path, settings, **options))
        return made[-1]

    yield make
    for supervisor in made:
        supervisor.stop()


@pytest.fixture
def supervisor(make_supervisor):
    return make_supervisor()


@pytest.fixture
def restarting(make_supervisor):
    return make_supervisor(restart=True)


def await_line(supervisor, name, text):
    end = time.monotonic() + GUARD_S
    while time.monotonic() < end:
        line = supervisor.poll(1.0)
        if line is not None and line.name == name and text in line.text:
            return line
    return pytest.fail(f"{name} does not say {text}")


def await_failure(supervisor):
    end = time.monotonic() + GUARD_S
    while time.monotonic() < end:
        supervisor.poll(1.0)


def test_a_line_of_a_process_comes_with_its_name(supervisor):
    supervisor.start("toy")
    line = await_line(supervisor, "toy", "msg=started")
    assert isinstance(line, Line)
    assert line.text == "t=0.000 level=info service=toy msg=started mode=real_time"


def test_when_nothing_is_said_expect_none(supervisor):
    assert supervisor.poll(0.0) is None
    assert supervisor.poll(0.001) is None


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("fails", "fails: the wheel came off"),
        ("crashes", "crashes: ZeroDivisionError: twice"),
        ("quits", "quits: ended with code 7"),
        ("nobody", "nobody: nobody: no such service; installed: "),
    ],
)
def test_when_a_process_fails_expect_its_own_words(supervisor, name, error):
    supervisor.start(name)
    with pytest.raises(ProcessError) as caught:
        await_failure(supervisor)
    assert str(caught.value).startswith(error)
    assert len(str(caught.value).splitlines()) == 1


def test_the_end_of_a_process_that_is_not_needed_is_told_and_is_no_error(supervisor):
    supervisor.start("fails", needed=False)
    assert await_line(supervisor, "fails", "error: the wheel came off")
    assert await_line(supervisor, "fails", "fails has ended; the others go on")
    assert supervisor.poll(0.0) is None


def kill(supervisor, name):
    await_line(supervisor, name, "msg=started")
    pid = supervisor.pids[name]
    os.kill(pid, signal.SIGKILL)
    return pid


def test_when_a_process_is_killed_expect_that_said(supervisor):
    supervisor.start("toy")
    kill(supervisor, "toy")
    with pytest.raises(ProcessError, match=r"^toy: was killed by SIGKILL$"):
        await_failure(supervisor)


@pytest.mark.parametrize("needed", [True, False])
def test_who_restarts_starts_a_killed_process_at_once_and_says_so_in_one_line(restarting, needed):
    restarting.start("toy", needed=needed)
    pid = kill(restarting, "toy")
    line = await_line(restarting, "toy", "SIGKILL")
    assert line.text == "toy: was killed by SIGKILL; it is started again at once"
    assert "msg=started" in restarting.poll(GUARD_S).text
    assert restarting.pids["toy"] != pid


def test_a_process_that_keeps_ending_is_started_again_after_a_growing_pause(
    restarting, monkeypatch
):
    monkeypatch.setattr(processes, "FIRST_PAUSE_S", 0.25)
    monkeypatch.setattr(processes, "MAX_PAUSE_S", 0.5)
    restarting.start("works_first")
    kill(restarting, "works_first")
    said = [
        await_line(restarting, "works_first", "started again").text.rpartition("; it is ")
        for _ in range(4)
    ]
    assert {how for how, _, _ in said[1:]} == {"works_first: no second time"}
    assert [when.removeprefix("started again ") for _, _, when in said] == [
        "at once",
        "in 0.25 s",
        "in 0.5 s",
        "in 0.5 s",
    ]


def test_a_process_that_ran_steadily_is_started_again_at_once(restarting, monkeypatch):
    monkeypatch.setattr(processes, "STEADY_S", 0.0)
    restarting.start("toy")
    for _ in range(3):
        kill(restarting, "toy")
        assert "at once" in await_line(restarting, "toy", "SIGKILL").text


@pytest.mark.parametrize(
    ("name", "error"),
    [("fails", "fails: the wheel came off"), ("crashes", "crashes: ZeroDivisionError: twice")],
)
def test_who_fails_before_it_ever_ran_is_not_started_again(restarting, name, error):
    restarting.start(name)
    with pytest.raises(ProcessError, match=rf"^{error}$"):
        await_failure(restarting)


def test_who_is_not_needed_and_fails_before_it_ever_ran_is_left_alone(restarting):
    restarting.start("fails", needed=False)
    assert await_line(restarting, "fails", "fails has ended; the others go on")
    assert restarting.poll(0.0) is None


def test_while_a_process_waits_to_be_started_again_others_are_heard(restarting, monkeypatch):
    monkeypatch.setattr(processes, "FIRST_PAUSE_S", 1000.0)
    restarting.start("works_first")
    kill(restarting, "works_first")
    await_line(restarting, "works_first", "in 8 s")
    restarting.start("toy")
    assert await_line(restarting, "toy", "msg=started")
    assert restarting.poll(0.01) is None
    assert restarting.stop() == []


def test_stop_ends_all_and_none_has_to_be_killed(supervisor):
    supervisor.start("toy")
    await_line(supervisor, "toy", "msg=started")
    assert supervisor.stop() == []
    assert not is_running(supervisor.pids["toy"])


def test_stop_names_who_had_to_be_killed(supervisor, monkeypatch):
    for name in ("toy", "deaf"):
        supervisor.start(name)
    heard = set()
    while heard != {"toy", "deaf"}:
        line = supervisor.poll(GUARD_S)
        assert line is not None
        if "deaf now" in line.text:
            heard.add("deaf")
        if line.name == "toy" and "msg=started" in line.text:
            heard.add("toy")
    monkeypatch.setattr(processes, "STOP_TIMEOUT_S", 3.0)
    assert supervisor.stop() == ["deaf"]
    assert supervisor.stop() == []
    for pid in supervisor.pids.values():
        assert not is_running(pid)


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_stop_of_nothing_is_nothing(supervisor):
    assert supervisor.stop() == []


def test_start_router_waits_until_it_listens(write_scenario, free_port):
    supervisor = Supervisor(write_scenario(), [f'bus.connect=["tcp/127.0.0.1:{free_port}"]'])
    try:
        supervisor.start_router(GUARD_S)
        socket.create_connection(("127.0.0.1", free_port)).close()
    finally:
        assert supervisor.stop() == []


def test_when_the_routers_port_is_taken_expect_its_own_words(write_scenario, router):
    supervisor = Supervisor(write_scenario(), [f'bus.connect=["{router}"]'])
    with pytest.raises(ProcessError, match=r"^router: can't listen on .*: the port is taken"):
        supervisor.start_router(GUARD_S)
    assert supervisor.stop() == []


def test_on_one_core_expect_one_core_inside_and_the_same_as_before_after():
    before = os.sched_getaffinity(0)
    with processes.on_one_core():
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def test_on_one_core_expect_programs_at_the_same_addresses_where_allowed():
    before = Path("/proc/self/personality").read_text()
    with processes.on_one_core():
        if Path("/proc/self/personality").read_text() == before:
            pytest.skip("to choose addresses is not allowed here")
        show = [sys.executable, "-c", "print(open('/proc/self/maps').read())"]
        first, second = (subprocess.check_output(show) for _ in range(2))
    assert first == second
    assert Path("/proc/self/personality").read_text() == before
