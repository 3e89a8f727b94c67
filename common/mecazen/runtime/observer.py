"""Observers: services that receive samples, answer nothing, and delay no tick."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping

from mecazen.bus import Bus
from mecazen.bus.base import Handler
from mecazen.config import Scenario
from mecazen.keys import Topic, of_robot
from mecazen.messages import MessageT
from mecazen.runtime.health import Health, Received
from mecazen.wire import NS_PER_S, Stamp


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
