"""Observers: services that receive samples, answer nothing, and delay no tick.

All services publish their health: once a simulated second, rates and ages of inputs, and refusals.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping
from typing import Any

from mecazen import keys
from mecazen.bus import Bus
from mecazen.bus.base import Handler
from mecazen.config import Scenario
from mecazen.keys import Topic, of_robot
from mecazen.loop import Slot
from mecazen.messages import DiagnosticArray, DiagnosticStatus, Header, KeyValue, MessageT
from mecazen.robots import join_key
from mecazen.wire import NS_PER_S, Stamp

PUBLISHERS = "publishers/"
"""Beginning of the names of values: of the programs on a key, by their Zenoh ids."""


class Received:
    """An input of an observer: the number of samples received and the tick of the newest one."""

    def __init__(self) -> None:
        self.count, self.newest = 0, -1


class Health:
    """Publishes the values that a service reports, and the state of its inputs by their keys."""

    def __init__(
        self,
        name: str,
        robot: str,
        bus: Bus,
        scenario: Scenario,
        inputs: Mapping[str, Received | Slot],
    ) -> None:
        self._name = name
        self.bus = bus
        self._scenario = scenario
        self._inputs = inputs
        self._tick_ns = scenario.sim.tick_ns
        self._publisher = bus.publisher(of_robot(keys.diagnostics(name), robot))
        self.reset()

    def reset(self) -> None:
        """Begin a run."""
        self._reported: Stamp | None = None
        self._counts = {key: received.count for key, received in self._inputs.items()}

    def publish(self, stamp: Stamp, values: Mapping[str, object]) -> None:
        """Publish values and the state of the inputs at a tick."""
        refused = self.bus.refused
        values = {**values, **self._rates(stamp), "refused_payloads": refused.total()}
        values |= {f"refused/{key}": count for key, count in refused.items()}
        values |= {f"lost/{key}": count for key, count in self.bus.lost.items()}
        returns = self.bus.presence.returns
        values |= {
            f"restarts/{part}": returns[part]
            for robot in dict.fromkeys(("", *self._scenario.names))
            for name in self._scenario.services
            if (part := join_key(name, robot)) in returns
        }
        programs = [str(ids) for key, ids in values.items() if key.startswith(PUBLISHERS)]
        message = "ok"
        if any(" " in ids for ids in programs):
            message = "several programs publish one key"
        if refused:
            message = "refused payloads"
        status = DiagnosticStatus(
            level=0 if message == "ok" else 1,
            name=self._name,
            message=message,
            values=tuple(KeyValue(key=key, value=str(value)) for key, value in values.items()),
        )
        header = Header(stamp=stamp.time)
        self._publisher.put(DiagnosticArray(header=header, status=(status,)), stamp)

    def _rates(self, stamp: Stamp) -> dict[str, Any]:
        last, self._reported = self._reported, stamp
        values: dict[str, Any] = {}
        for key, received in self._inputs.items():
            count = received.count - self._counts.get(key, 0)
            self._counts[key] = received.count
            if last is not None and stamp.time_ns > last.time_ns:
                values[f"hz/{key}"] = round(count * NS_PER_S / (stamp.time_ns - last.time_ns), 1)
                age_ns = stamp.time_ns - received.newest * self._tick_ns
                values[f"age_s/{key}"] = "never" if received.newest < 0 else age_ns / NS_PER_S
        return values


class Observer(ABC):
    """A service that shows or records the samples of nodes.

    The first sample of a new run calls `reset`. Samples of ended runs are dropped.
    """

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        self.name = name
        self.bus = bus
        self.scenario = scenario
        self.stamp = Stamp(0, 0, scenario.seed)
        """Stamp of the newest tick received."""
        self._ended: deque[int] = deque(maxlen=16)
        self._received: dict[str, Received] = {}
        self._health = Health(name, "", bus, scenario, self._received)

    @abstractmethod
    def reset(self, seed: int) -> None:
        """Begin a run."""

    def run(self) -> None:
        """Deliver samples until the bus is stopped."""
        while True:
            self.bus.spin_once()

    def close(self) -> None:  # noqa: B027  # some have nothing to do
        """Release resources, after the bus was stopped or a run is over."""

    def diagnostics(self) -> Mapping[str, object]:
        """Return values on the service's health, by name."""
        return {}

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], robot: str = ""
    ) -> None:
        """Deliver the samples of a topic that belong to this run or have no stamp.

        An open topic, on which any client may publish, begins no run.
        """
        on_bus = of_robot(topic, robot)
        received = self._received.setdefault(on_bus.key, Received())

        def take(message: MessageT, stamp: Stamp | None) -> None:
            if stamp is not None and not self._is_current(stamp, begins=not topic.open):
                return
            received.count += 1
            received.newest = (stamp or self.stamp).time_ns // self.scenario.sim.tick_ns
            handler(message, stamp)

        self.bus.subscribe(on_bus, take)

    def _is_current(self, stamp: Stamp, *, begins: bool) -> bool:
        """Return whether a sample belongs to this run; begin a new run if `begins` allows it."""
        last = self.stamp
        if stamp.run != last.run:
            if stamp.run in self._ended or not begins:
                return False
            self._ended.append(last.run)
            self.stamp = stamp
            for received in self._received.values():
                received.newest = -1
            self._health.reset()
            self.reset(stamp.seed)
        elif stamp.time_ns <= last.time_ns:
            return True
        elif begins:
            self.stamp = stamp
        if self.stamp.time_ns // NS_PER_S != last.time_ns // NS_PER_S or stamp.run != last.run:
            self._health.publish(self.stamp, self.diagnostics())
        return True
