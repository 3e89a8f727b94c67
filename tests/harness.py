"""Helpers for the tests of all services: commands, a simulated bus, and rigs."""

import io
import logging
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from hostile import Put
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import BusConfig, Scenario
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import Topic
from mecazen.messages import Message, Twist
from mecazen.node import Inputs, Node, Tick
from mecazen.programs import Kind
from mecazen.robot import Robot
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host
from mecazen.runtime.worker import Worker
from mecazen.wire import Stamp, decode, encode

ROOT = Path(__file__).parents[1]
ROBOTS = ROOT / "configs" / "robots"
SCENARIOS = ROOT / "configs" / "scenarios"
COMMAND_GUARD_S = 180.0
"""Far beyond what any command takes: only a hang gets there."""


def command(arguments: Sequence[object], folder: Path = ROOT, **variables: str) -> dict[str, Any]:
    """Return the arguments of `subprocess` for a command in a folder, with its environment."""
    return {
        "args": [sys.executable, "-m", "mecazen_tools", *map(str, arguments)],
        "text": True,
        "cwd": folder,
        "env": {**os.environ, "COLUMNS": "160", "TERM": "dumb", **variables},
    }


def mecazen(
    *arguments: object, folder: Path = ROOT, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, in a process of its own."""
    starts = command(arguments, folder, **variables)
    return subprocess.run(**starts, capture_output=True, timeout=COMMAND_GUARD_S, check=False)


def here(
    *arguments: object, folder: Path = ROOT, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end as `mecazen` does, but in this process, which has started."""
    from mecazen_tools.cli.app import main  # not every environment of a service has it

    printed = io.BytesIO(), io.BytesIO()
    out, err = (io.TextIOWrapper(buffer, "utf-8", write_through=True) for buffer in printed)
    with (
        pytest.MonkeyPatch.context() as patch,
        redirect_stdout(out),
        redirect_stderr(err),
        chdir(folder),
    ):
        for name, value in {"COLUMNS": "160", "TERM": "dumb", **variables}.items():
            patch.setenv(name, value)
        patch.setattr(sys, "argv", ["mecazen", *map(str, arguments)])
        # a command that logs sends it to its standard error
        patch.setattr(logging.root, "handlers", [])
        patch.setattr(logging.root, "level", logging.root.level)
        with pytest.raises(SystemExit) as ended:
            main()
    texts = (buffer.getvalue().decode() for buffer in printed)
    return subprocess.CompletedProcess(arguments, int(ended.value.code or 0), *texts)


class Command:
    """A running command, in a process of its own."""

    def __init__(self, *arguments: object) -> None:
        self.process: subprocess.Popen[str] = subprocess.Popen(
            **command(arguments, PYTHONUNBUFFERED="1"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self.text = ""
        """The output so far."""

    def read_until(self, words: str) -> str:
        """Read what it prints until some words come; return the line with them."""
        for line in self.process.stdout:
            self.text += line
            if words in line:
                return line
        raise AssertionError(f"ended without {words!r}: {self.text}")

    def await_start(self) -> None:
        """Wait until it says that it has started."""
        assert "msg=started" in self.process.stderr.readline()

    def end(self, number: int | None = signal.SIGINT) -> tuple[int, str, str]:
        """Send a signal, Ctrl-C's by default; return the exit code, what it printed and errors."""
        if number is not None:
            self.process.send_signal(number)
        out, err = self.process.communicate(timeout=COMMAND_GUARD_S)
        return self.process.returncode, self.text + out, err


def assert_one_line(done: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    """A command failed, and said why in one line with some words in it."""
    assert done.returncode == code, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    for word in words:
        assert word in done.stderr


def is_running(pid: int) -> bool:
    """Whether there is such a process."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def options(settings: Sequence[str]) -> list[str]:
    """Return the options that lay settings over a scenario."""
    return [f"--set={setting}" for setting in settings]


def tools(bus: BusConfig) -> tuple[str, ...]:
    """Return the options by which tools reach those who meet on a bus."""
    assert bus.connect is not None
    assert bus.namespace is not None
    return ("--connect", bus.connect[0], "--namespace", bus.namespace)


def load_robot(name: str = "nexus") -> Robot:
    return msgspec.convert(tomllib.loads((ROBOTS / f"{name}.toml").read_text()), Robot)


def forward(speed: float) -> Twist:
    """A command of a speed straight on [m/s]."""
    return Twist.planar(Twist2D(speed))


def error_of(kind: type[Exception], run: Callable[[], object]) -> str:
    """Return what the error that something raises says, in one line."""
    with pytest.raises(kind) as caught:
        run()
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


class Sample(NamedTuple):
    key: str
    message: Any
    stamp: Stamp | None


class Newest:
    """The newest sample of a topic: `message` and `stamp`, None before the first."""

    def __init__(self, bus: Any, topic: Topic[Any]) -> None:
        self.message: Any = None
        self.stamp: Any = None
        bus.subscribe(topic, self._take)

    def _take(self, message: Any, stamp: Stamp | None) -> None:
        self.message, self.stamp = message, stamp

    @property
    def pose(self) -> Pose2D:
        """The pose of the newest odometry."""
        pose: Pose2D = self.message.pose.pose.to_planar()
        return pose


def wait(bus: Any, condition: Callable[[], bool]) -> None:
    """Deliver samples until a condition holds."""
    end = time.monotonic() + COMMAND_GUARD_S
    while not condition():
        assert time.monotonic() < end, "what was waited for did not come"
        bus.spin_once(0.05)


class Listener:
    """Keeps what is published on some topics, in the order of publishing."""

    def __init__(self, bus: Bus, *topics: Topic[Any]) -> None:
        self._samples: list[Sample] = []
        for topic in topics:
            self._listen(bus, topic)

    def _listen(self, bus: Bus, topic: Topic[Any]) -> None:
        bus.subscribe(topic, lambda *sample: self._samples.append(Sample(topic.key, *sample)))

    def take(self) -> list[Sample]:
        """Everything since the last call."""
        samples, self._samples = self._samples, []
        return samples


class Rig:
    """One service of a scenario on a bus within the process, fed by hand.

    `at` gives the stamps of its run; `take` returns its samples since the last call.
    With `kinds` its nodes are of these classes, by their names.
    """

    def __init__(
        self,
        service: str,
        scenario: Scenario,
        *topics: Topic[Any],
        kinds: Mapping[str, Kind] | None = None,
    ) -> None:
        self.scenario = scenario
        self.bus = Bus()
        host = Host([(service, "")], self.bus, scenario, kinds)
        self.driver = Worker(host) if host.clock is None else Clock(host)
        self.samples = Listener(self.bus, *topics)
        self.health = Listener(self.bus, keys.diagnostics(service))
        self._publishers: dict[Topic[Any], Any] = {}

    def at(self, tick: int, run: int = 1, seed: int = 9) -> Stamp:
        return Stamp(tick * self.scenario.sim.tick_ns, run, seed)

    def put(self, topic: Topic[Any], message: Message, tick: int | Stamp) -> list[Sample]:
        """Publish a message with the stamp of a tick; return the samples of the service."""
        publisher = self._publishers.setdefault(topic, self.bus.publisher(topic))
        publisher.put(message, tick if isinstance(tick, Stamp) else self.at(tick))
        return self.take()

    @property
    def node(self) -> Any:
        """The first of its nodes."""
        return self.driver.host.loop.turns[0].running

    def take(self) -> list[Sample]:
        while isinstance(self.driver, Worker) and self.driver.step():
            pass
        return self.samples.take()

    def put_wrong(self, wrong: Sequence[Put]) -> list[Sample]:
        """Publish what an external program does; return what the service says, all sendable."""
        samples = []
        for put in wrong:
            self.bus.put_bytes(*put)
            samples += self.take()
        for sample in samples + self.health.take():
            assert_sendable(sample)
        return samples


class Steps:
    """A node by itself, stepped by hand: no bus, nothing faked. `inputs` are its newest.

    Args:
        kind: Its class.
        scenario: Its configuration, and the seed that it begins with.
        tick_s: From one tick to the next [s]; left out: the scenario's control period.
    """

    def __init__(self, kind: type[Node], scenario: Scenario, tick_s: float | None = None) -> None:
        self.node = kind(scenario)
        self.tick_ns = round((tick_s or scenario.sim.tick_s) * 1e9)
        self.refused: list[str] = []
        """Keys of the samples that the node could not use."""
        self.reset(scenario.seed)

    def reset(self, seed: int) -> None:
        self._last: int | None = None
        self._came: dict[Topic[Any], int] = {}
        self.node.reset(seed)

    def step(self, tick: int, samples: Mapping[Topic[Any], Message]) -> dict[Topic[Any], Any]:
        """Return the outputs of a tick; of the last one again, its step is done again."""
        known_ns = {topic: came * self.tick_ns for topic, came in self._came.items()}
        self.inputs = inputs = Inputs(samples, known_ns, tick * self.tick_ns)
        period_ns = self.tick_ns * (1 if self._last is None else tick - self._last)
        outputs = self.node.step(Tick(tick, tick * self.tick_ns, period_ns / 1e9), inputs)
        refused = [topic for topic, _ in inputs.refused]
        self.refused += [topic.key for topic in refused]
        self._came |= {topic: tick for topic in samples if topic not in refused}
        self._last = tick
        return dict(outputs)


def assert_sendable(sample: Sample) -> None:
    """Check that other services accept a sample: its numbers are finite."""
    message = sample.message
    assert decode(encode(message), type(message)) == message
    assert sample.stamp is None or Stamp.unpack(sample.stamp.pack()) == sample.stamp
