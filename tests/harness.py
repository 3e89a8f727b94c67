"""What the tests of all services share: the rest of the bus, and payloads that are wrong."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import BusConfig, Scenario
from mecazen.errors import BusError, MecazenError
from mecazen.geometry import Pose2D
from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.node import Inputs, Node, Tick
from mecazen.programs import Kind, classes
from mecazen.robot import Robot
from mecazen.runtime.host import make_nodes
from mecazen.wire import ENCODINGS, Stamp, decode, encode

ROOT = Path(__file__).parents[1]
ROBOTS = ROOT / "configs" / "robots"
SCENARIOS = ROOT / "configs" / "scenarios"
COMMAND_GUARD_S = 60.0
"""Far beyond what any command takes: only a hang gets there."""


def command(arguments: Sequence[object], **variables: str) -> dict[str, Any]:
    """What `subprocess` is told of a command, with some variables in its environment."""
    return {
        "args": [sys.executable, "-m", "mecazen_tools", *map(str, arguments)],
        "text": True,
        "cwd": ROOT,
        "env": {**os.environ, "COLUMNS": "160", "TERM": "dumb", **variables},
    }


def mecazen(
    *arguments: object, before: Callable[[], None] | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; `before` is called in its process, before it begins."""
    return subprocess.run(
        **command(arguments, **variables),
        capture_output=True,
        timeout=COMMAND_GUARD_S,
        check=False,
        preexec_fn=before,
    )


class Command:
    """A command that goes on, in a process of its own."""

    def __init__(self, *arguments: object) -> None:
        self.process: subprocess.Popen[str] = subprocess.Popen(
            **command(arguments, PYTHONUNBUFFERED="1"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self.text = ""
        """What it has printed so far."""

    def read_until(self, words: str) -> str:
        """Read what it prints until some words come; return the line with them."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.text += line
            if words in line:
                return line
        raise AssertionError(f"ended without {words!r}: {self.text}")

    def await_start(self) -> None:
        """Wait until it says that it has started."""
        assert self.process.stderr is not None
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


def options(settings: Sequence[str]) -> list[str]:
    """Return the options that lay settings over a scenario."""
    return [f"--set={setting}" for setting in settings]


def endpoint_of(settings: Sequence[str]) -> str:
    """Return where processes meet, as `private_router` has it."""
    return settings[0].split('"')[1]


def tools(bus: BusConfig) -> tuple[str, ...]:
    """Return the options by which tools reach those who meet on a bus."""
    assert bus.connect is not None
    assert bus.namespace is not None
    return ("--connect", bus.connect[0], "--namespace", bus.namespace)


def load_robot(name: str = "nexus") -> Robot:
    return msgspec.convert(tomllib.loads((ROBOTS / f"{name}.toml").read_text()), Robot)


def error_of(kind: type[MecazenError], run: Callable[[], object]) -> str:
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
        """Of odometry."""
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

    def __init__(self, bus: LocalBus, *topics: Topic[Any]) -> None:
        self._heard: list[Sample] = []
        for topic in topics:
            self._listen(bus, topic)

    def _listen(self, bus: LocalBus, topic: Topic[Any]) -> None:
        bus.subscribe(topic, lambda *sample: self._heard.append(Sample(topic.key, *sample)))

    def take(self) -> list[Sample]:
        """Everything since the last call."""
        heard, self._heard = self._heard, []
        return heard


class Rig:
    """One service of a scenario on a bus within the process, fed by hand.

    `at` gives the stamps of its run; `take` what it has published since the last call.
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
        self.bus = LocalBus()
        self.service = make_nodes(service, kinds or classes(service, scenario), self.bus, scenario)
        self.heard = Listener(self.bus, *topics)
        self.health = Listener(self.bus, keys.diagnostics(service))
        self._publishers: dict[Topic[Any], Any] = {}

    def at(self, tick: int, run: int = 1, seed: int = 9) -> Stamp:
        return Stamp(tick * self.scenario.sim.tick_ns, run, seed)

    def put(self, topic: Topic[Any], message: Message, tick: int | Stamp) -> list[Sample]:
        """Publish a message as of a tick, and return what the service publishes then."""
        publisher = self._publishers.setdefault(topic, self.bus.publisher(topic))
        publisher.put(message, tick if isinstance(tick, Stamp) else self.at(tick))
        return self.take()

    def take(self) -> list[Sample]:
        self.bus.spin()
        return self.heard.take()

    def put_wrong(self, wrong: Sequence[Put]) -> list[Sample]:
        """Publish what an outsider does, and return what the service says: all of it sendable."""
        put_all(self.bus, wrong)
        heard = self.take()
        for sample in heard + self.health.take():
            assert_sendable(sample)
        return heard


class Steps:
    """A node by itself, stepped by hand: no bus, nothing faked.

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
        ages_s = {topic: (tick - came) * self.tick_ns / 1e9 for topic, came in self._came.items()}
        inputs = Inputs(samples, ages_s)
        period_ns = self.tick_ns * (1 if self._last is None else tick - self._last)
        outputs = self.node.step(Tick(tick, tick * self.tick_ns, period_ns / 1e9), inputs)
        refused = [topic for topic, _ in inputs.refused]
        self.refused += [topic.key for topic in refused]
        self._came |= {topic: tick for topic in samples if topic not in refused}
        self._last = tick
        return dict(outputs)


class Answer:
    """A reply that may come later than the request."""

    def __init__(self) -> None:
        self.message: Any = None
        self.error: str | None = None

    def answer(self, message: Any) -> None:
        assert self.message is None
        assert self.error is None
        self.message = message

    def refuse(self, reason: str) -> None:
        self.answer(BusError(reason))
        self.message, self.error = None, reason


def assert_sendable(sample: Sample) -> None:
    """What a service says, every other accepts: above all, its numbers are finite."""
    message = sample.message
    for form in ENCODINGS:
        assert decode(encode(message, form), type(message)) == message
    assert sample.stamp is None or Stamp.unpack(sample.stamp.pack()) == sample.stamp


class Put(NamedTuple):
    """What an outsider puts on a key."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None


FUZZ = settings(
    max_examples=120,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[Phase.generate],  # with Phase.shrink a failure is shorter, and comes minutes later
)
"""Examples of up to 40 payloads each: thousands."""

_EXTREME = [1e-320, -0.0, 10.0, 1e5, 1e6, -1e7, 1e155, 1e200, 1e308, -1e308, 1.797e308, -1.797e308]
_HOSTILE: list[Any] = [None, True, "", "1", [], {}, [[]], [0.0] * 36, [1e308] * 36, [-1.0] * 36]
_HOSTILE += [0, -1, 2**31, 2**32, -(2**31), 2**63, -(2**63), 10**30, *_EXTREME]
_HOSTILE += [float("nan"), float("inf"), float("-inf"), "\ud7ff", "é" * 50, list(range(200))]


@st.composite
def _payload(draw: st.DrawFn, messages: Sequence[Message]) -> bytes:
    """Random bytes, or a good message with bytes or values damaged, or numbers extreme."""
    message = draw(st.sampled_from(messages))
    kind = draw(st.integers(0, 7))
    if kind == 0:
        return draw(st.binary(max_size=60))
    if kind == 1:
        payload = bytearray(encode(message, draw(st.sampled_from(["json", "msgpack"]))))
        for _ in range(draw(st.integers(1, 3))):
            begin = draw(st.integers(0, len(payload)))
            end = begin + draw(st.sampled_from([0, 1, 3, len(payload)]))
            payload[begin:end] = draw(st.binary(max_size=3))
        return bytes(payload)
    tree = msgspec.to_builtins(message)
    for _ in range(draw(st.integers(0, 3))):
        _damage(draw, tree, extreme=kind < 5)
    try:
        return msgspec.msgpack.encode(tree) if kind % 2 else json.dumps(tree).encode()
    except OverflowError:  # MessagePack has no such integer
        return json.dumps(tree).encode()


def _damage(draw: st.DrawFn, node: Any, *, extreme: bool) -> None:
    """Put a hostile value in a random place of a tree of dicts and lists.

    Where it is to be `extreme`, it is a number in a number's place, so that the message stays
    one that its key carries.
    """
    while node:
        places = list(node) if isinstance(node, dict) else list(range(len(node)))
        place = draw(st.sampled_from(places))
        child = node[place]
        leaf = not isinstance(child, dict | list) or not child
        if extreme and leaf:
            if isinstance(child, float):
                node[place] = draw(st.sampled_from(_EXTREME))
            return
        if leaf or (not extreme and draw(st.integers(0, 5)) == 0):
            node[place] = deepcopy(draw(st.sampled_from(_HOSTILE)))
            return
        node = child


NO_STAMP = st.none() | st.binary(max_size=24).filter(lambda data: len(data) != 16)
"""Attachments that are no stamps."""

_TIMES = st.sampled_from([0, 10_000_000, 2**31 * 10**9 - 1, 2**31 * 10**9, 2**63 - 1, -1])
_RUNS = st.integers(0, 3) | st.integers(0, 2**31)
FORGED = NO_STAMP | st.builds(
    lambda *stamp: struct.pack("<qII", *stamp),
    _TIMES | st.integers(0, 10**10) | st.integers(-(2**63), 2**63 - 1),
    _RUNS,
    st.integers(0, 2**32 - 1),
)
"""Those, and stamps of any tick of any run, of which the later half is never used."""


def puts(
    good: Mapping[str, Sequence[Message]], attachments: st.SearchStrategy[bytes | None]
) -> st.SearchStrategy[list[Put]]:
    """Wrong payloads, and extreme but right ones, on the keys of `good`, made from its messages."""
    one = st.sampled_from(sorted(good)).flatmap(
        lambda key: st.builds(
            Put,
            st.just(key),
            _payload(good[key]),
            st.sampled_from(["", "", *ENCODINGS.values(), "text/plain", "\x00"]),
            attachments,
        )
    )
    return st.lists(one, min_size=15, max_size=40)


def put_all(bus: LocalBus, wrong: Sequence[Put]) -> None:
    for put in wrong:
        bus.put_bytes(*put)
    bus.spin()


def malformed(good: Mapping[str, Sequence[Message]]) -> Callable[[Any], Any]:
    """Test with `wrong` payloads on the keys of `good`, none of them with a stamp."""
    return lambda test: FUZZ(given(wrong=puts(good, NO_STAMP))(test))


def forged(
    good: Mapping[str, Sequence[Message]], max_examples: int = FUZZ.max_examples
) -> Callable[[Any], Any]:
    """Test with `wrong` payloads on the keys of `good`, with stamps of any tick and run."""
    fuzz = settings(FUZZ, max_examples=max_examples)
    return lambda test: fuzz(given(wrong=puts(good, FORGED))(test))
