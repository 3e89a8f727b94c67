"""The supervisor starts processes, passes on the error of one that fails, and ends all."""

import os
import secrets
import socket
import time

import pytest
from mecazen import processes
from mecazen.processes import Line, ProcessError, Supervisor

GUARD_S = 60.0
"""Only ends a test that would hang."""

TOY = """
import signal, sys

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
def supervisor(write_scenario, tmp_path, router):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(
        "services = []\n[programs]\n"
        + "".join(
            f"{name} = '../toy.py:{name.title()}'\n"
            for name in ("toy", "fails", "crashes", "quits", "deaf")
        )
    )
    namespace = f"test{secrets.token_hex(6)}"
    supervisor = Supervisor(path, [f'bus.connect=["{router}"]', f"bus.namespace={namespace}"])
    yield supervisor
    supervisor.stop()


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
