"""What every service is: subscriptions, a computation, publications, and nothing else."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from typing import ClassVar, TypeVar

from mecazen import keys
from mecazen.bus import Bus
from mecazen.bus.base import Handler
from mecazen.config import Scenario, join_key
from mecazen.keys import Topic
from mecazen.messages import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    KeyValue,
    Message,
)
from mecazen.wire import Stamp

MessageT = TypeVar("MessageT", bound=Message)

NS_PER_S = 10**9


class _Input:
    """What has come on one key."""

    __slots__ = ("count", "newest")

    def __init__(self) -> None:
        self.count = 0
        """Samples since the last report."""
        self.newest: Stamp | None = None
        """Of the newest sample of this run."""


class Service(ABC):
    """A part of the simulation on a bus.

    A subclass subscribes in its constructor, through `subscribe`, and answers each sample in
    its handler. State that belongs to a run is made in `reset`, which is called by the
    constructor, and again before the first sample of a new run.
    """

    NAME: ClassVar[str]
    """The service's role: its liveliness token, and its section in a scenario."""

    OWNS_TIME: ClassVar[bool] = False
    """Whether this service makes the ticks and the runs that all others follow."""

    PRIORITY: ClassVar[int] = 0
    """Among processes that go before all others, the higher first; 0 is not one of them. For
    what works so briefly that it keeps nobody waiting."""

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.bus = bus
        self.scenario = scenario
        self.tick_ns = scenario.sim.tick_ns
        self.stamp = Stamp(0, 0, scenario.seed)
        """The newest tick that this service has heard of."""
        self.missed_ticks = 0
        """Ticks that others were given and this service never heard of, or not in time."""
        self._ended_runs: deque[int] = deque(maxlen=16)
        self._inputs: dict[str, _Input] = {}
        self._reported = self.stamp
        bus.presence.on_return.append(self.on_return)
        self._diagnostics = bus.publisher(keys.diagnostics(self.NAME))
        self.reset(scenario.seed)

    @abstractmethod
    def reset(self, seed: int) -> None:
        """Begin a run: back to the start, with random numbers from `seed`."""

    def run(self) -> None:
        """Work until the bus is stopped."""
        while True:
            self.bus.spin_once()

    def close(self) -> None:  # noqa: B027  # most have nothing to do
        """End the work, after the bus was stopped or a run is over."""

    def diagnostics(self) -> Mapping[str, object]:
        """Return what the service says of its health, by name."""
        return {}

    def on_return(self, name: str) -> None:  # noqa: B027  # most have nothing to do
        """Take note that another service is back after it had gone."""

    def subscribe(
        self,
        topic: Topic[MessageT],
        handler: Handler[MessageT],
        *,
        every: bool = False,
        advances_clock: bool = True,
        robot: str = "",
    ) -> None:
        """Deliver samples of this run; one of a new run resets the service first.

        Where `advances_clock` is false, as on a key that anyone writes, samples of another run
        are dropped: they can't end this one. With the name of a `robot`, one of several, it
        is its topic.
        """
        heard = self._inputs.setdefault(join_key(topic.key, robot), _Input())

        def deliver(message: MessageT, stamp: Stamp | None) -> None:
            # within a process all samples of a tick have the same stamp: most are known at once
            if (
                stamp is not None
                and stamp is not self.stamp
                and not (self._is_current(stamp) if advances_clock else stamp.run == self.stamp.run)
            ):
                return
            heard.count += 1
            heard.newest = stamp or self.stamp
            handler(message, stamp)

        self.bus.namespaced(robot).subscribe(topic, deliver, every=every)

    def answer_every_tick(
        self, topic: Topic[MessageT], handler: Callable[[MessageT, Stamp], None]
    ) -> None:
        """Deliver only stamped samples, each tick once: what makes a part of the loop."""
        last = Stamp(-1, 0, 0)
        period_ns = 0  # not every key has a sample in every tick

        def deliver(message: MessageT, stamp: Stamp | None) -> None:
            nonlocal last, period_ns
            if stamp is None:
                return
            if stamp.run == last.run:
                passed_ns = stamp.time_ns - last.time_ns
                if passed_ns <= 0:
                    return
                if passed_ns != period_ns:
                    period_ns = min(period_ns or passed_ns, passed_ns)
                    self.missed_ticks += passed_ns // period_ns - 1
            else:
                period_ns = 0
            last = stamp
            handler(message, stamp)

        self.subscribe(topic, deliver)

    def tick_of(self, stamp: Stamp) -> int:
        """Return the number of a stamp's tick; the first of a run is 0."""
        return stamp.time_ns // self.tick_ns

    def _is_current(self, stamp: Stamp) -> bool:
        if self.OWNS_TIME:
            return stamp.run == self.stamp.run
        if stamp.run != self.stamp.run:
            if stamp.run in self._ended_runs:
                return False
            self._ended_runs.append(self.stamp.run)
            self.stamp = stamp
            self.reset(stamp.seed)
            self.publish_diagnostics()
        elif stamp.time_ns > self.stamp.time_ns:
            last, self.stamp = self.stamp, stamp
            if stamp.time_ns // NS_PER_S > last.time_ns // NS_PER_S:
                self.publish_diagnostics()
        return True

    def publish_diagnostics(self) -> None:
        """Publish the service's health; done once each simulated second."""
        refused = self.bus.refused.total()
        values = {**self.diagnostics(), **self._inputs_health(), "refused_payloads": refused}
        for key, count in self.bus.refused.items():
            values[f"refused/{key}"] = count
        for robot in dict.fromkeys(("", *self.scenario.names)):
            returns = self.bus.namespaced(robot).presence.returns
            for name in self.scenario.services:
                if name in returns:
                    values[f"restarts/{join_key(name, robot)}"] = returns[name]
        status = DiagnosticStatus(
            level=1 if refused else 0,
            name=self.NAME,
            message="refused payloads" if refused else "ok",
            values=tuple(KeyValue(key=key, value=str(value)) for key, value in values.items()),
        )
        header = Header(stamp=self.stamp.time)
        self._diagnostics.put(DiagnosticArray(header=header, status=(status,)), self.stamp)

    def _inputs_health(self) -> dict[str, object]:
        """Return each key's rate since the last report, and the age of its newest sample."""
        now, last = self.stamp, self._reported
        self._reported = now
        values: dict[str, object] = {} if self.OWNS_TIME else {"missed_ticks": self.missed_ticks}
        elapsed_ns = now.time_ns - last.time_ns if now.run == last.run else 0
        for key, heard in self._inputs.items():
            if elapsed_ns > 0:
                values[f"hz/{key}"] = round(heard.count * NS_PER_S / elapsed_ns, 1)
                newest = heard.newest
                values[f"age_s/{key}"] = (
                    "never" if newest is None else (now.time_ns - newest.time_ns) / NS_PER_S
                )
            else:  # a run has begun
                heard.newest = None
            heard.count = 0
        return values
