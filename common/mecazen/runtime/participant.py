"""What takes part in runs: hears the samples of the current one, and reports its health."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from mecazen import keys
from mecazen.bus import Bus
from mecazen.bus.base import Handler
from mecazen.config import Scenario
from mecazen.keys import Topic
from mecazen.messages import DiagnosticArray, DiagnosticStatus, Header, KeyValue, MessageT
from mecazen.robots import join_key
from mecazen.wire import NS_PER_S, Stamp

EARLY_AT_MOST = 16
"""Samples that are kept for a run that has not begun here: of each topic one may be ahead."""


class _Heard:
    """What has come on one key."""

    __slots__ = ("count", "newest")

    def __init__(self) -> None:
        self.count = 0
        """Samples since the last report."""
        self.newest: Stamp | None = None
        """Of the newest sample of this run."""


class Participant:
    """A service on a bus, of one robot or of all.

    Samples of a new run have it begin anew with `reset`; those of ended runs are dropped.

    Args:
        name: The service's name.
        bus: In the namespace of its robot.
        scenario: As its robot sees it.
    """

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        self.name = name
        self.bus = bus
        self.scenario = scenario
        self.tick_ns = scenario.sim.tick_ns
        self.stamp = Stamp(0, 0, scenario.seed)
        """The newest tick that it has heard of."""
        self.announce: Callable[[str], None] = lambda _: None
        """Takes the address of a page that the service serves."""
        self._ended_runs: deque[int] = deque(maxlen=16)
        self._early: deque[tuple[Handler[Any], Any, Stamp]] = deque(maxlen=EARLY_AT_MOST)
        """Samples of other runs than this one, on topics that begin none."""
        self._heard: dict[str, _Heard] = {}
        self._of_robots: set[Topic[Any]] = set()
        """Topics of one of several robots, where this is of all."""
        self._reported = self.stamp
        self._diagnostics = bus.publisher(keys.diagnostics(name))

    def reset(self, seed: int) -> None:
        """Begin a run with random numbers from `seed`."""

    def run(self) -> None:
        """Work until the bus is stopped."""
        while True:
            self.bus.spin_once()

    def close(self) -> None:
        """End the work, after the bus was stopped or a run is over."""

    def diagnostics(self) -> Mapping[str, object]:
        """Return what it says of its health, by name."""
        return {}

    def subscribe(
        self,
        topic: Topic[MessageT],
        handler: Handler[MessageT],
        *,
        every: bool = False,
        robot: str = "",
    ) -> None:
        """Deliver the samples of a topic that belong to this run, or have no stamp.

        The first sample of a new run resets the participant before it is delivered; not on a
        topic that anyone publishes on, nor between what is of one robot and what is of all, which
        have other seeds: there it is kept until the run begins. With the name of
        a `robot` it is that robot's topic.
        """
        heard = self._heard.setdefault(join_key(topic.key, robot), _Heard())
        advances_clock = not topic.open and not topic.shared and topic not in self._of_robots

        def deliver(message: MessageT, stamp: Stamp | None) -> None:
            # within a process all samples of a tick have the same stamp: most are known at once
            if stamp is not None and stamp is not self.stamp:
                if advances_clock:
                    if not self._is_current(stamp):
                        return
                elif stamp.run != self.stamp.run:
                    # another node may have heard of a new run, and answered, before this one
                    self._early.append((deliver, message, stamp))
                    return
            heard.count += 1
            heard.newest = stamp or self.stamp
            handler(message, stamp)

        self.bus.namespaced(robot).subscribe(topic, deliver, every=every)

    def _is_current(self, stamp: Stamp) -> bool:
        if stamp.run != self.stamp.run:
            if stamp.run in self._ended_runs:
                return False
            self._ended_runs.append(self.stamp.run)
            self.stamp = stamp
            self.reset(stamp.seed)
            self.publish_diagnostics()
            early = [sample for sample in self._early if sample[2].run == stamp.run]
            self._early.clear()
            for deliver, message, at in early:
                deliver(message, at)
        elif stamp.time_ns > self.stamp.time_ns:
            last, self.stamp = self.stamp, stamp
            if stamp.time_ns // NS_PER_S > last.time_ns // NS_PER_S:
                self.publish_diagnostics()
        return True

    def publish_diagnostics(self) -> None:
        """Publish the service's health; done once each simulated second."""
        refused = self.bus.refused.total()
        values: dict[str, Any] = {**self.diagnostics(), **self._inputs_health()}
        values["refused_payloads"] = refused
        for key, count in self.bus.refused.items():
            values[f"refused/{key}"] = count
        ignored = self.bus.ignored
        values |= {f"ignored/{key}": told for key, told in ignored.items()}
        for robot in dict.fromkeys(("", *self.scenario.names)):
            returns = self.bus.namespaced(robot).presence.returns
            for name in self.scenario.services:
                if name in returns:
                    values[f"restarts/{join_key(name, robot)}"] = returns[name]
        status = DiagnosticStatus(
            level=1 if refused or ignored else 0,
            name=self.name,
            message="refused payloads" if refused else "unknown fields" if ignored else "ok",
            values=tuple(KeyValue(key=key, value=str(value)) for key, value in values.items()),
        )
        header = Header(stamp=self.stamp.time)
        self._diagnostics.put(DiagnosticArray(header=header, status=(status,)), self.stamp)

    def _inputs_health(self) -> dict[str, object]:
        """Return each key's rate since the last report, and the age of its newest sample."""
        now, last = self.stamp, self._reported
        self._reported = now
        values: dict[str, object] = {}
        elapsed_ns = now.time_ns - last.time_ns if now.run == last.run else 0
        for key, heard in self._heard.items():
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
