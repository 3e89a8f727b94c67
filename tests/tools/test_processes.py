"""The supervisor starts processes, passes on what they write, restarts them and ends all."""

import os
import re
import secrets
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest
from harness import COMMAND_GUARD_S, is_running
from mecazen.config import Process
from mecazen.errors import MecazenError
from mecazen_tools import processes
from mecazen_tools.processes import Line, Supervisor

TOY = """
import logging, signal, subprocess, sys
from pathlib import Path

from mecazen.errors import BusError, ConfigError
from mecazen.row import Row
from mecazen.node import Node
from mecazen.runtime.observer import Observer


class Toy(Node):
    ROW = Row("toy")

    def reset(self, seed):
        logging.warning("msg=hello")

    def step(self, tick, inputs):
        return {}


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
        sys.stderr.write("half a line")
        sys.exit(7)


class Deaf(Toy):
    def reset(self, seed):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


class Page(Observer):
    def reset(self, seed):
        logging.info("msg=serving url=http://127.0.0.1:1")
"""
NODES = ("toy", "quits", "deaf", "works_first", "misfit", "starts_another")
PROGRAMS = {name: f"toy.py:{name.title()}" for name in NODES} | {"viewer": "toy.py:Page"}
KILLED = """
import sys
from pathlib import Path
from mecazen.config import Process
from mecazen.errors import MecazenError
from mecazen_tools.processes import Supervisor

supervisor = Supervisor(Path(sys.argv[1]), sys.argv[2:])
supervisor.start(Process(("toy",)))
while not supervisor.works("toy"):
    supervisor.poll(0.1)
print(supervisor.pids["toy"], flush=True)
supervisor.poll(1000.0)
"""


@pytest.fixture
def scenario(write_scenario, tmp_path, router):
    """The file of a scenario with the toys, and settings of a namespace of its own."""
    (tmp_path / "toy.py").write_text(TOY)
    lines = "".join(f"{name} = '../{program}'\n" for name, program in PROGRAMS.items())
    settings = [f'bus.connect=["{router}"]', f"bus.namespace=test{secrets.token_hex(6)}"]
    return write_scenario("services = []\n[programs]\n" + lines), settings


class Watched(Supervisor):
    """A supervisor that waits for lines and states."""

    def close(self):
        self.stop()

    def begin(self, *names, needed=True):
        for name in names:
            self.start(Process((name,)), needed=needed)

    def lines(self):
        """Yield lines of all processes, and None now and then."""
        end = time.monotonic() + COMMAND_GUARD_S
        while time.monotonic() < end:
            yield self.poll(0.1)
        pytest.fail("the line or state did not come")

    def line(self, text):
        """Return the next line with a text in it."""
        return next(line for line in self.lines() if line and text in line.text)

    def failure(self):
        with pytest.raises(MecazenError) as caught:
            for _ in self.lines():
                pass
        return str(caught.value)

    def pid(self, name):
        """Return the id of a process once it works."""
        return next(self.pids[name] for _ in self.lines() if self.works(name))

    def kill(self, name):
        pid = self.pid(name)
        os.kill(pid, signal.SIGKILL)
        return pid


@pytest.fixture
def supervisor(scenario):
    with closing(Watched(*scenario)) as supervisor:
        yield supervisor


@pytest.fixture
def restarting(scenario):
    with closing(Watched(*scenario, restart=True)) as supervisor:
        yield supervisor


def await_end(pid):
    end = time.monotonic() + COMMAND_GUARD_S
    while is_running(pid):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_warnings_and_addresses_have_names(supervisor):
    supervisor.begin("toy")
    line = supervisor.line("hello")
    assert line == Line("toy", "t=0.000 level=warning service=toy msg=hello")
    supervisor.begin("viewer")
    assert supervisor.line("http") == Line("viewer", "http://127.0.0.1:1", is_address=True)


@pytest.mark.parametrize(
    ("name", "error"),
    [("quits", "quits: half a line"), ("nobody", "nobody: no such node; nodes: ")],
)
def test_process_that_never_worked_fails(restarting, name, error):
    restarting.begin(name)
    failure = restarting.failure()
    assert failure.startswith(error)
    assert len(failure.splitlines()) == 1


def test_end_of_an_optional_process_is_no_error(restarting):
    restarting.begin("nobody", needed=False)
    line = restarting.line("ended")
    assert re.fullmatch("nobody has ended: no such node; .*; the others go on", line.text)
    assert restarting.poll(0.0) is None


def test_subprocess_does_not_delay_the_end(supervisor):
    supervisor.begin("starts_another")
    sleeper = int(supervisor.line("warning").text.rpartition(" ")[2])
    supervisor.kill("starts_another")
    assert supervisor.failure() == "starts_another: was killed by SIGKILL"
    os.kill(sleeper, signal.SIGKILL)  # which raises if it has ended


def test_pauses_grow_while_a_process_keeps_ending(restarting, monkeypatch):
    monkeypatch.setattr(processes, "FIRST_PAUSE_S", 0.25)
    monkeypatch.setattr(processes, "MAX_PAUSE_S", 0.5)
    # on a busy machine the kill may come late: still, it has not worked for a while
    monkeypatch.setattr(processes, "STEADY_S", COMMAND_GUARD_S)
    restarting.begin("works_first")
    restarting.kill("works_first")
    lines = [restarting.line("started again").text for _ in range(4)]
    assert [text.removeprefix("works_first: ") for text in lines] == [
        "was killed by SIGKILL; it is started again at once",
        "no second time; it is started again in 0.25 s",
        "no second time; it is started again in 0.5 s",
        "no second time; it is started again in 0.5 s",
    ]


def test_unsuitable_process_is_not_restarted(restarting):
    restarting.begin("misfit")
    restarting.kill("misfit")
    assert "at once" in restarting.line("SIGKILL").text
    assert restarting.failure() == "misfit: no second time"


def test_stop_ends_all_and_names_killed_processes(supervisor, monkeypatch):
    supervisor.begin("toy", "deaf")
    pids = [supervisor.pid("toy"), supervisor.pid("deaf")]
    monkeypatch.setattr(processes, "STOP_TIMEOUT_S", 3.0)
    assert supervisor.stop() == ["deaf"]
    assert supervisor.stop() == []
    assert not any(map(is_running, pids))


def test_killed_fork_server_restarts_its_processes(restarting):
    restarting.begin("toy")
    pid = restarting.pid("toy")
    status = Path(f"/proc/{pid}/status").read_text()
    os.kill(int(re.search(r"PPid:\s+(\d+)", status)[1]), signal.SIGKILL)
    line = restarting.line("has ended with the fork server")
    assert line.text.endswith("; it is started again in 0.5 s")
    await_end(pid)
    assert restarting.pid("toy") != pid


def test_processes_end_if_their_supervisor_is_killed(scenario):
    path, settings = scenario
    command = [sys.executable, "-c", KILLED, path, *settings]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        pid = int(program.stdout.readline())
        program.kill()
        assert program.stdout.read() == ""  # until the fork server has ended, too
    await_end(pid)
