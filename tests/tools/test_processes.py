"""The supervisor starts processes, passes on the error of one that fails, and ends all."""

import os
import re
import secrets
import signal
import socket
import time
from pathlib import Path

import pytest
from harness import COMMAND_GUARD_S, is_running
from mecazen.config import Process
from mecazen_tools import processes
from mecazen_tools.processes import Line, ProcessError, Supervisor

TOY = """
import logging, signal, subprocess, sys
from pathlib import Path

from mecazen.errors import BusError, ConfigError
from mecazen.row import Row
from mecazen.node import Node


class Toy(Node):
    ROW = Row("toy")

    def reset(self, seed):
        logging.warning("msg=hello")

    def step(self, tick, inputs):
        return {}


class Quiet(Toy):
    def reset(self, seed):
        pass


class Fails(Toy):
    def reset(self, seed):
        raise BusError("the wheel came off")


class Crashes(Toy):
    def reset(self, seed):
        raise ZeroDivisionError("twice")


class Works_First(Toy):
    ERROR = BusError

    def reset(self, seed):
        mark = Path(__file__).with_suffix(".mark")
        if mark.exists():
            raise self.ERROR("no second time")
        mark.touch()


class Misfit(Works_First):
    ERROR = ConfigError


class Starts_Another(Toy):
    def reset(self, seed):
        logging.warning("%d", subprocess.Popen(["sleep", "1000"]).pid)


class Quits(Toy):
    def reset(self, seed):
        sys.exit(7)


class Deaf(Toy):
    def reset(self, seed):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
"""

TOYS = (
    "toy",
    "quiet",
    "fails",
    "crashes",
    "quits",
    "deaf",
    "works_first",
    "misfit",
    "starts_another",
)


@pytest.fixture
def make_supervisor(write_scenario, tmp_path, router):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(
        "services = []\n[programs]\n"
        + "".join(f"{name} = '../toy.py:{name.title()}'\n" for name in TOYS)
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


def start(supervisor, name, **options):
    supervisor.start(Process((name,)), **options)


def lines(supervisor):
    """Yield what is said, and None now and then."""
    end = time.monotonic() + COMMAND_GUARD_S
    while time.monotonic() < end:
        yield supervisor.poll(0.1)
    pytest.fail("what was waited for did not come")


def await_line(supervisor, name, text):
    """Return the next line of a process with a text in it."""
    return next(
        line for line in lines(supervisor) if line and line.name == name and text in line.text
    )


def await_failure(supervisor):
    with pytest.raises(ProcessError) as caught:
        for _ in lines(supervisor):
            pass
    return str(caught.value)


def await_work(supervisor, name):
    return next(supervisor.pids[name] for _ in lines(supervisor) if supervisor.works(name))


def kill(supervisor, name):
    pid = await_work(supervisor, name)
    os.kill(pid, signal.SIGKILL)
    return pid


def test_a_line_of_a_process_comes_with_its_name(supervisor):
    start(supervisor, "toy")
    line = await_line(supervisor, "toy", "hello")
    assert line == Line("toy", "t=0.000 level=warning service=toy msg=hello")


@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("fails", "fails: the wheel came off"),
        ("crashes", "crashes: ZeroDivisionError: twice"),
        ("quits", "quits: ended with code 7"),
        ("nobody", "nobody: no such node; nodes: "),
    ],
)
def test_when_a_process_fails_before_it_ever_worked_expect_its_own_words(
    make_supervisor, name, error, restart
):
    supervisor = make_supervisor(restart=restart)
    start(supervisor, name)
    failure = await_failure(supervisor)
    assert failure.startswith(error)
    assert len(failure.splitlines()) == 1


@pytest.mark.parametrize("restart", [False, True])
def test_the_end_of_a_process_that_is_not_needed_is_told_with_its_reason_and_is_no_error(
    make_supervisor, restart
):
    supervisor = make_supervisor(restart=restart)
    start(supervisor, "fails", needed=False)
    line = await_line(supervisor, "fails", "ended")
    assert line.text == "fails has ended: the wheel came off; the others go on"
    assert supervisor.poll(0.0) is None


def test_when_a_process_is_killed_expect_that_said(supervisor):
    start(supervisor, "toy")
    kill(supervisor, "toy")
    assert await_failure(supervisor) == "toy: was killed by SIGKILL"


def test_the_end_of_a_process_is_noted_while_its_own_subprocess_holds_its_log_open(supervisor):
    start(supervisor, "starts_another")
    other = int(await_line(supervisor, "starts_another", "").text.rpartition(" ")[2])
    kill(supervisor, "starts_another")
    assert await_failure(supervisor) == "starts_another: was killed by SIGKILL"
    os.kill(other, signal.SIGKILL)  # which raises if it has ended


@pytest.mark.parametrize("needed", [True, False])
def test_who_restarts_starts_a_killed_process_at_once_and_says_so_in_one_line(restarting, needed):
    start(restarting, "toy", needed=needed)
    pid = kill(restarting, "toy")
    line = await_line(restarting, "toy", "SIGKILL")
    assert line.text == "toy: was killed by SIGKILL; it is started again at once"
    assert await_work(restarting, "toy") != pid


def test_a_process_that_keeps_ending_is_started_again_after_a_growing_pause(
    restarting, monkeypatch
):
    monkeypatch.setattr(processes, "FIRST_PAUSE_S", 0.25)
    monkeypatch.setattr(processes, "MAX_PAUSE_S", 0.5)
    # on a busy machine the kill may come late: still, it has not worked for a while
    monkeypatch.setattr(processes, "STEADY_S", COMMAND_GUARD_S)
    start(restarting, "works_first")
    kill(restarting, "works_first")
    said = [await_line(restarting, "works_first", "started again").text for _ in range(4)]
    assert [text.removeprefix("works_first: ") for text in said] == [
        "was killed by SIGKILL; it is started again at once",
        "no second time; it is started again in 0.25 s",
        "no second time; it is started again in 0.5 s",
        "no second time; it is started again in 0.5 s",
    ]


def test_a_process_that_its_scenario_does_not_suit_is_not_started_again_after_work_either(
    restarting,
):
    start(restarting, "misfit")
    kill(restarting, "misfit")
    assert "at once" in await_line(restarting, "misfit", "SIGKILL").text
    assert await_failure(restarting) == "misfit: no second time"


def test_a_process_that_worked_steadily_is_started_again_at_once(restarting, monkeypatch):
    monkeypatch.setattr(processes, "STEADY_S", 0.0)
    start(restarting, "toy")
    for _ in range(3):
        kill(restarting, "toy")
        assert "at once" in await_line(restarting, "toy", "SIGKILL").text


def test_while_a_process_waits_to_be_started_again_others_are_heard(restarting, monkeypatch):
    monkeypatch.setattr(processes, "FIRST_PAUSE_S", 1000.0)
    start(restarting, "works_first")
    kill(restarting, "works_first")
    await_line(restarting, "works_first", "in 8 s")
    start(restarting, "toy")
    assert await_line(restarting, "toy", "hello")
    await_work(restarting, "toy")
    assert restarting.poll(0.01) is None
    assert restarting.stop() == []


def test_stop_ends_all_and_none_has_to_be_killed(supervisor):
    start(supervisor, "toy")
    await_work(supervisor, "toy")
    assert supervisor.stop() == []
    assert not is_running(supervisor.pids["toy"])


def test_stop_names_who_had_to_be_killed(supervisor, monkeypatch):
    for name in ("toy", "deaf"):
        start(supervisor, name)
    for name in ("toy", "deaf"):
        await_work(supervisor, name)
    monkeypatch.setattr(processes, "STOP_TIMEOUT_S", 3.0)
    assert supervisor.stop() == ["deaf"]
    assert supervisor.stop() == []
    for pid in supervisor.pids.values():
        assert not is_running(pid)


def test_start_router_waits_until_it_listens(write_scenario, free_port):
    supervisor = Supervisor(write_scenario(), [f'bus.connect=["tcp/127.0.0.1:{free_port}"]'])
    try:
        supervisor.start_router(COMMAND_GUARD_S)
        socket.create_connection(("127.0.0.1", free_port)).close()
    finally:
        assert supervisor.stop() == []


def test_when_the_routers_port_is_taken_expect_its_own_words(write_scenario, router):
    supervisor = Supervisor(write_scenario(), [f'bus.connect=["{router}"]'])
    with pytest.raises(ProcessError, match=r"^router: can't listen on .*: the port is taken"):
        supervisor.start_router(COMMAND_GUARD_S)
    assert supervisor.stop() == []


def test_on_one_core_expect_one_core_inside_and_the_same_as_before_after():
    before = os.sched_getaffinity(0)
    with processes.on_one_core():
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def code_at(pid):
    """Return the addresses of the interpreter's and the libraries' code in a process."""
    maps = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {line.split()[0] for line in maps if "r-xp" in line and ".so" in line}


def test_forks_have_their_code_at_the_same_addresses_that_each_start_places_at_random(
    make_supervisor,
):
    one, another = make_supervisor(), make_supervisor()
    pids = []
    for supervisor, name in ((one, "toy"), (one, "works_first"), (another, "quiet")):
        start(supervisor, name)
        pids.append(await_work(supervisor, name))
    first, second, apart = map(code_at, pids)
    assert first & second
    assert not first & apart
    assert int(Path(f"/proc/{pids[0]}/personality").read_text(), 16) == 0


def test_a_fork_has_a_name_and_a_session_of_its_own_and_shares_memory_with_its_parent(supervisor):
    start(supervisor, "toy")
    pid = await_work(supervisor, "toy")
    assert Path(f"/proc/{pid}/comm").read_text() == "toy\n"
    assert os.getsid(pid) == pid
    sizes = dict(re.findall(r"(\w+): +(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_text()))
    # a process that was started apart shares none of what is not a file's
    assert int(sizes["Shared_Dirty"]) > int(sizes["Anonymous"]) / 3


def test_when_the_parent_is_killed_expect_its_forks_to_end_and_to_be_started_again(restarting):
    start(restarting, "toy")
    pid = await_work(restarting, "toy")
    status = Path(f"/proc/{pid}/status").read_text()
    os.kill(int(re.search(r"PPid:\s+(\d+)", status)[1]), signal.SIGKILL)
    line = await_line(restarting, "toy", "has ended with the parent of all processes")
    assert line.text.endswith("; it is started again at once")
    assert await_work(restarting, "toy") != pid


def test_when_every_parent_ends_at_once_expect_one_line(supervisor, monkeypatch):
    monkeypatch.setattr(processes.Parent, "start", lambda *_: None)
    with pytest.raises(ProcessError, match=r"^the parent of all processes has ended$"):
        start(supervisor, "toy")
