"""The whole loop: in one process, as processes over Zenoh, its messages only, and its parts."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from contextlib import closing
from pathlib import Path
from typing import Any, cast

from mecazen.bus import Bus, LocalBus
from mecazen.bus.base import Handler, Publisher
from mecazen.config import Scenario
from mecazen.keys import Topic
from mecazen.loading import load_scenario
from mecazen.messages import MessageT
from mecazen.wire import Stamp
from mecazen_tools.processes import Supervisor, on_one_core, private_router
from mecazen_tools.simulate import InProcess, Result, simulate, simulate_distributed

from mecazen_bench import hops
from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.physics import peer_rtf
from mecazen_bench.stack import SCENARIOS

PATH = SCENARIOS / "back.toml"
DURATION_S = 10.0
NULL_PHYSICS = f'programs.physics="{Path(__file__).with_name("null_physics.py")}:NullPhysics"'

GROUP = ("controller", "target", "follower")
GROUPED = f"processes={json.dumps([GROUP])}"

REAL_TIMES = Target(low=25.0)
DISTRIBUTED_REAL_TIMES = Target(low=12.0)
OF_ONE_PROCESS, OF_ONE_PROCESS_GROUPED = Target(low=0.6), Target(low=0.75)
OF_MUJOCO = Target(low=1.0)
MESSAGING_TICKS = Target(low=4000.0)
SHARE = Target(high=10.0)

BUS = "messages and bus"
UNBOUNDED = ("physics", "follower")
"""Parts whose share has no target: their computation is the purpose of the loop."""


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` in each of the ways, and divide a tick into its parts."""
    settings = (f"sim.duration_s={duration_s}",)
    return [_ways(settings, duration_s), parts(settings, duration_s)]


def _ways(settings: tuple[str, ...], duration_s: float) -> Group:
    def row(
        name: str,
        result: Result,
        ticks: Target | Better = "more",
        real_time: Target | Better = "more",
        share: Target | Better = "more",
        of_peer: Target | Better = "more",
    ) -> Row:
        figures = {
            "ticks/s": Figure.of(result.ticks / result.wall_s, ticks),
            "× real time": Figure.of(result.rtf, real_time),
            "of one process": Figure.of(result.rtf / one.rtf, share),
        }
        if peer is not None:
            figures["of MuJoCo"] = Figure.of(result.rtf / peer, of_peer)
        return Row(name, figures)

    name, peer = PATH.stem, peer_rtf()
    one, _ = simulate(load_scenario(PATH, settings), name)
    distributed, _ = simulate_distributed(PATH, settings, name)
    grouped, _ = simulate_distributed(PATH, (*settings, GROUPED), name)
    messages, _ = simulate_distributed(PATH, (*settings, NULL_PHYSICS), name)
    rows = (
        row("in one process", one, real_time=REAL_TIMES, of_peer=OF_MUJOCO),
        row("distributed", distributed, real_time=DISTRIBUTED_REAL_TIMES, share=OF_ONE_PROCESS),
        row("physics, and the others in one", grouped, share=OF_ONE_PROCESS_GROUPED),
        row("distributed, without physics", messages, MESSAGING_TICKS),
        _bare("bare Zenoh, distributed", settings, one),
        _bare("bare Zenoh, physics and the others", (*settings, GROUPED), one),
    )
    how = (
        f"lockstep; {duration_s:g} s, without the start; MuJoCo: its physics alone, of the robot "
        "with capsules at 1 ms; bare Zenoh: processes that pass on bytes, as many and as long, and "
        "how fast, of one process, that and its tick would be together"
    )
    return Group("Whole loop: scenario back", how, rows)


def _bare(name: str, settings: tuple[str, ...], one: Result) -> Row:
    """Return how fast a distributed run could be at most."""
    settings = (*settings, *private_router())
    supervisor = Supervisor(PATH, settings)
    try:
        with on_one_core():
            supervisor.start_router()
        ticks_s = hops.rate(load_scenario(PATH, settings), one.ticks)
    finally:
        supervisor.stop()
    share = ticks_s / (ticks_s + one.ticks / one.wall_s)
    return Row(
        name,
        {"ticks/s": Figure.of(ticks_s, "more"), "of one process": Figure.of(share, "more")},
    )


def parts(settings: tuple[str, ...], duration_s: float) -> Group:
    """Divide a tick of the scenario `back` into the parts of its services."""
    scenario = load_scenario(PATH, settings)
    ns = _timed_run(scenario)
    total = sum(ns.values())
    rows = []
    for part in (*scenario.services, "trajectory", BUS):
        goal: Target | Better = "less" if part in UNBOUNDED else SHARE
        figures = {
            "µs/tick": Figure.of(ns[part] / 1e3, "less"),
            "% of the tick": Figure.of(100.0 * ns[part] / total, goal),
        }
        rows.append(Row(part, figures))
    rows.append(Row("all", {"µs/tick": Figure.of(total / 1e3, "less")}))
    how = (
        f"in one process; means over {duration_s:g} s of a part's handlers with "
        "the messages that they make, and the stopwatch's own time"
    )
    of_kind = "" if scenario.sensor.kind == "pose" else f", sensor {scenario.sensor.kind}"
    return Group(f"Parts of a tick: scenario back{of_kind}", how, tuple(rows))


def _timed_run(scenario: Scenario) -> dict[str, float]:
    """Return the mean time of each part in a tick [ns]."""
    watch = Stopwatch()
    count = 0
    with closing(InProcess(scenario, watch.seen_by)) as loop:
        for _ in loop.ticks():
            if not count:
                watch.ns.clear()  # the first answers take longer
            count += 1
            watch.turn_to("physics")
        watch.turn_to(BUS)
    return {part: ns / count for part, ns in watch.ns.items()}


class Stopwatch:
    """Adds up the time of each part of a run; one is active at any time."""

    def __init__(self) -> None:
        self.ns: defaultdict[str, int] = defaultdict(int)
        self._part = BUS
        self._since = time.perf_counter_ns()

    def turn_to(self, part: str) -> None:
        """Count for `part` from now on."""
        now = time.perf_counter_ns()
        self.ns[self._part] += now - self._since
        self._part, self._since = part, now

    def seen_by(self, bus: LocalBus, part: str) -> Bus:
        """Return the bus as a part sees it, timed."""
        return cast(Bus, TimedBus(bus, self, part))


class TimedBus:
    """A bus as one part of the loop sees it: its handlers count as the part's time.

    Publishing counts as the bus's time, and so does everything between two handlers.
    """

    def __init__(self, bus: LocalBus, watch: Stopwatch, part: str) -> None:
        self._bus, self._watch, self._part = bus, watch, part

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def namespaced(self, name: str) -> TimedBus:
        bus = self._bus.namespaced(name)
        return self if bus is self._bus else TimedBus(bus, self._watch, self._part)

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        return _TimedPublisher(self._bus.publisher(topic), self._watch, self._part)

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        def timed(message: MessageT, stamp: Stamp | None) -> None:
            self._watch.turn_to(self._part)
            handler(message, stamp)
            self._watch.turn_to(BUS)

        self._bus.subscribe(topic, timed, every=every)


class _TimedPublisher(Publisher[MessageT]):
    def __init__(self, publisher: Publisher[MessageT], watch: Stopwatch, part: str) -> None:
        self._publisher, self._watch, self._part = publisher, watch, part

    def put(self, message: MessageT, stamp: Stamp | None) -> None:
        self._watch.turn_to(BUS)
        self._publisher.put(message, stamp)
        self._watch.turn_to(self._part)
