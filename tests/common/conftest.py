"""Buses that meet each other, and a wall clock that tests set."""

import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest
from harness import COMMAND_GUARD_S, wait
from mecazen.bus import Bus, StoppedError
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.keys import Topic
from mecazen.messages import String
from mecazen.wire import Stamp

END = Topic("test/end", String, "all before it has arrived")


@pytest.fixture
def open_bus(router):
    """Open Zenoh buses that meet in one random namespace by default."""
    random = f"test{secrets.token_hex(6)}"
    buses = []

    def open_one(namespace=random):
        buses.append(ZenohBus(BusConfig(connect=(router,), namespace=namespace)))
        return buses[-1]

    yield open_one
    for bus in buses:
        bus.close()


class Pair:
    """One bus that listens and answers, and one that publishes and asks.

    On the local bus both are the same.
    """

    def __init__(self, near: Bus, far: Bus) -> None:
        self.near = near
        self.far = far
        self._ended = 0
        self._ready = 0
        near.subscribe(END, self._on_end, every=True)
        near.declare_alive("near")
        far.declare_alive("far")  # who is alive itself sees who else is

    @property
    def is_local(self) -> bool:
        return self.near is self.far

    def link(self) -> None:
        """Wait until what the far bus puts reaches every subscription of the near one.

        A token is declared after the subscriptions, so who sees it knows them.
        """
        self._ready += 1
        name = f"near{self._ready}"
        self.near.declare_alive(name)
        wait(self.far, lambda: name in self.far.presence.names)

    def settle(self) -> None:
        """Deliver everything that the far bus has put so far."""
        awaited = self._ended + 1
        self.far.publisher(END).put(String(), Stamp(0, 0, 0))
        wait(self.near, lambda: self._ended == awaited)

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Let the near bus work while the far one waits for its answers."""
        if self.is_local:
            yield
            return
        thread = threading.Thread(target=self._run)
        thread.start()
        try:
            yield
        finally:
            self.near.stop()
            thread.join(COMMAND_GUARD_S)
            assert not thread.is_alive()

    def _run(self) -> None:
        with suppress(StoppedError):
            while True:
                self.near.spin_once()

    def _on_end(self, message: String, stamp: Stamp | None) -> None:
        del message, stamp
        self._ended += 1


@pytest.fixture
def bus():
    """A bus within this process."""
    return Bus()


@pytest.fixture
def zenoh_pair(open_bus):
    return Pair(open_bus(), open_bus())


@pytest.fixture(params=["local", "zenoh"])
def pair(request, bus):
    return Pair(bus, bus) if request.param == "local" else request.getfixturevalue("zenoh_pair")


@pytest.fixture
def put(bus):
    """Publish a message with a stamp on that bus."""
    return lambda topic, message, stamp: bus.publisher(topic).put(message, stamp)


@pytest.fixture
def wall(monkeypatch):
    """The schedule's wall clock: it stands at 100 s, or advances by `step_s` with each look."""
    wall = SimpleNamespace(now=100.0, step_s=0.0)

    def monotonic():
        wall.now += wall.step_s
        return float(wall.now)

    monkeypatch.setattr("mecazen.runtime.pace.time", SimpleNamespace(monotonic=monotonic))
    return wall
