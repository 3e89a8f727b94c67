"""Health reports of a service: rates and ages of inputs, and refusals, once a simulated second."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.keys import of_robot
from mecazen.loop import Slot
from mecazen.messages import DiagnosticArray, DiagnosticStatus, Header, KeyValue
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
