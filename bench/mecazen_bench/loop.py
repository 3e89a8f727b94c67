"""The whole loop: in one process, as processes over Zenoh, its messages alone, and its parts."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from mecazen.bus import Bus, LocalBus
from mecazen.bus.base import Handler, Publisher
from mecazen.config import Scenario
from mecazen.keys import Topic
from mecazen.loading import load_scenario
from mecazen.messages import Message
from mecazen.runtime import find_service
from mecazen.wire import Stamp
from mecazen_tools.simulate import Result, in_lockstep, simulate, simulate_distributed
from mecazen_tools.trajectory import Trajectory

from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.scenarios import SCENARIOS

DURATION_S = 10.0
STEPS = ("physics.dt_s=0.001",)
NULL_PHYSICS = Path(__file__).with_name("null_physics.py")

REAL_TIMES = Target.at_least(25.0)
DISTRIBUTED_REAL_TIMES = Target.at_least(12.0)
MESSAGING_TICKS = Target.at_least(4000.0)
SHARE = Target.below(10.0)

BUS = "messages and bus"
HEAVY = ("physics", "follower")
"""Parts whose share has no bound: what they compute is what the loop is for."""

MessageT = TypeVar("MessageT", bound=Message)


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` in each of the ways, and take a tick to its parts."""
    return [_ways(duration_s), _parts(duration_s)]


def _ways(duration_s: float) -> Group:
    path = SCENARIOS / "back.toml"
    settings = (*STEPS, f"sim.duration_s={duration_s}")
    nothing = (*settings, f'programs.physics="{NULL_PHYSICS}:NullPhysics"')
    ways: dict[str, Callable[[], tuple[Result, object]]] = {
        "in one process": lambda: simulate(load_scenario(path, settings), path.stem),
        "distributed": lambda: simulate_distributed(path, settings, path.stem),
        "distributed, physics replaced by nothing": lambda: simulate_distributed(
            path, nothing, path.stem
        ),
    }
    goals: tuple[tuple[Target | Better, Target | Better], ...] = (
        ("more", REAL_TIMES),
        ("more", DISTRIBUTED_REAL_TIMES),
        (MESSAGING_TICKS, "more"),
    )
    rows = []
    for (name, way), (ticks, real_times) in zip(ways.items(), goals, strict=True):
        result, _ = way()
        figures = {
            "ticks/s": Figure.of(result.ticks / result.wall_s, ticks),
            "× real time": Figure.of(result.rtf, real_times),
        }
        rows.append(Row(name, figures))
    how = f"lockstep, physics at 1 ms; {duration_s:g} s, without the start"
    return Group("The loop: scenario back", how, tuple(rows))


class Stopwatch:
    """Adds up how long each part of a run has been at work; one is at any time."""

    def __init__(self) -> None:
        self.ns: defaultdict[str, int] = defaultdict(int)
        self._part = BUS
        self._since = time.perf_counter_ns()

    def turn_to(self, part: str) -> None:
        """Let `part` be at work from now on."""
        now = time.perf_counter_ns()
        self.ns[self._part] += now - self._since
        self._part, self._since = part, now


class TimedBus:
    """A bus as one part of the loop sees it: its handlers count as the part's time.

    Publishing counts as the bus's, and so does all that is between two handlers.
    """

    def __init__(self, bus: LocalBus, watch: Stopwatch, part: str) -> None:
        self._bus, self._watch, self._part = bus, watch, part

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def namespaced(self, name: str) -> TimedBus:
        """Return the bus of a namespace, timed for the same part."""
        bus = self._bus.namespaced(name)
        return self if bus is self._bus else TimedBus(bus, self._watch, self._part)

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return what publishes on a topic, timed."""
        return _TimedPublisher(self._bus.publisher(topic), self._watch, self._part)

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        """Deliver samples of a topic to `handler`, timed."""

        def timed(message: MessageT, stamp: Stamp | None) -> None:
            self._watch.turn_to(self._part)
            handler(message, stamp)
            self._watch.turn_to(BUS)

        self._bus.subscribe(topic, timed, every=every)


class _TimedPublisher(Publisher[MessageT]):
    def __init__(self, publisher: Publisher[MessageT], watch: Stopwatch, part: str) -> None:
        self._publisher, self._watch, self._part = publisher, watch, part

    def put(self, message: MessageT, stamp: Stamp) -> None:
        self._watch.turn_to(BUS)
        self._publisher.put(message, stamp)
        self._watch.turn_to(self._part)


def _parts(duration_s: float) -> Group:
    settings = (*STEPS, f"sim.duration_s={duration_s}")
    scenario = in_lockstep(load_scenario(SCENARIOS / "back.toml", settings))
    ns = _timed_run(scenario)
    total = sum(ns.values())
    rows = [
        Row(
            part,
            {
                "µs/tick": Figure.of(ns[part] / 1e3, "less"),
                "% of the tick": Figure.of(
                    100.0 * ns[part] / total, "less" if part in HEAVY else SHARE
                ),
            },
        )
        for part in (*scenario.services, "trajectory", BUS)
    ]
    rows.append(Row("all", {"µs/tick": Figure.of(total / 1e3, "less")}))
    how = (
        f"in one process, physics at 1 ms; means over {duration_s:g} s of a part's handlers with "
        "the messages that they make, and the stopwatch's own time"
    )
    return Group("A tick, part by part: scenario back", how, tuple(rows))


def _timed_run(scenario: Scenario) -> dict[str, float]:
    """Return the mean time of each part in a tick [ns]."""
    bus, watch = LocalBus(), Stopwatch()

    def seen_by(part: str) -> Bus:
        return cast(Bus, TimedBus(bus, watch, part))

    sim, services = scenario.sim, scenario.services
    Trajectory(seen_by("trajectory"), sim.tick_ns, sim.ticks, services)
    parts = {part: find_service(part, scenario)(seen_by(part), scenario) for part in services}
    for part in parts:
        bus.declare_alive(part)
    physics = cast(Any, parts["physics"])
    physics.begin()
    watch.ns.clear()
    for _ in range(sim.ticks - 1):
        watch.turn_to(BUS)
        physics.await_answers()
        watch.turn_to("physics")
        physics.step()  # which has nothing to wait for any more
    watch.turn_to(BUS)
    return {part: ns / (sim.ticks - 1) for part, ns in watch.ns.items()}
