"""Hours of simulated time: memory, ticks, and the schedule."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Any

from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario
from mecazen.messages import Clock, Message
from mecazen.runtime.readiness import announce_readiness
from mecazen.wire import Stamp
from mecazen_tools.processes import beside_that_core, on_one_core

from mecazen_bench.stack import SCENARIOS, running

WITNESS = "witness"
"""The part that counts ticks; in lockstep physics waits until it is ready."""
SCENARIO = "circle"
"""Its person walks without end."""
EVERY_TICK = (keys.CLOCK, keys.ODOM, keys.TARGET_ODOM, keys.FOLLOWER_STATE, keys.JOINT_COMMAND)

SAMPLE_S = 60.0
"""Simulated time between two measurements of memory."""
SETTLED_S = 600.0
"""Simulated time after which memory may grow ..."""
GROWTH_MB = 5.0
"""... by this at most."""
DRIFT_MS = 10.0
"""Largest drift of the schedule against the wall clock."""
WINDOW_S = 5.0
"""At both ends of a real-time run, the earliest tick of this time counts: others were late."""
PATIENCE_S = 0.25


class Ticks:
    """Counts missing and repeated samples of keys that have one in every tick."""

    def __init__(self, bus: ZenohBus, tick_ns: int) -> None:
        self.newest = 0
        self.missed = self.repeated = 0
        self._tick_ns = tick_ns
        topics: tuple[keys.Topic[Any], ...] = EVERY_TICK
        for topic in topics:
            bus.subscribe(topic, self._counter(), every=True)

    def _counter(self) -> Callable[[Message, Stamp | None], None]:
        last = -1

        def count(_: Message, stamp: Stamp | None) -> None:
            nonlocal last
            assert stamp is not None
            tick = stamp.time_ns // self._tick_ns
            self.missed += max(0, tick - last - 1)
            self.repeated += tick <= last
            last = tick
            self.newest = max(self.newest, tick)

        return count


def lockstep(hours: float) -> bool:
    """Simulate as fast as possible; return whether memory and ticks pass, and print them."""
    settled: dict[str, float] = {}
    most: dict[str, float] = {}
    parts = load_scenario(SCENARIOS / f"{SCENARIO}.toml").services
    services = json.dumps([*parts, WITNESS])
    settings = "sim.mode=lockstep", f"sim.duration_s={hours * 3600.0}", f"services={services}"
    with ExitStack() as exits:
        with on_one_core():  # as of `mecazen simulate --distributed`
            stack = exits.enter_context(running(SCENARIO, *settings, services=parts))
        with beside_that_core():
            bus = exits.enter_context(closing(ZenohBus(stack.scenario.bus, lossless=True)))
        sim = stack.scenario.sim
        ticks = Ticks(bus, sim.tick_ns)
        bus.declare_alive(WITNESS)
        announce_readiness(bus, WITNESS, stack.scenario)
        begin, due_s = time.monotonic(), SAMPLE_S
        while ticks.newest < sim.ticks - 1:
            if not bus.spin_once(PATIENCE_S):
                stack.supervisor.poll(0.0)
            time_s = ticks.newest * sim.tick_s
            if time_s < due_s:
                continue
            due_s += SAMPLE_S
            # unique memory: what processes share is not counted
            memory = {
                name: process.memory_full_info().uss / 2**20
                for name, process in stack.processes().items()
            }
            if time_s < SETTLED_S + SAMPLE_S:
                settled = memory
            most = {name: max(mb, most.get(name, 0.0)) for name, mb in memory.items()}
            shown = "  ".join(f"{name} {mb:.1f}" for name, mb in memory.items())
            print(f"{time_s / 60:6.0f} min  {shown} MB", flush=True)
        wall_s = time.monotonic() - begin
        while bus.spin_once(PATIENCE_S):
            pass
    print(
        f"{hours:g} h of simulated time in {wall_s / 60:.1f} min; "
        f"{ticks.missed} ticks missed, {ticks.repeated} repeated"
    )
    grown = {name: most[name] - settled[name] for name in settled}
    for name, mb in grown.items():
        print(f"{name:11} {settled[name]:6.1f} MB after {SETTLED_S / 60:g} min, then {mb:+.2f} MB")
    return max(grown.values()) <= GROWTH_MB and not ticks.missed and not ticks.repeated


def real_time(minutes: float) -> bool:
    """Run in real time; return whether the schedule keeps to the wall clock, and print it."""
    ticks: list[tuple[float, float]] = []

    def on_clock(_: Clock, stamp: Stamp | None) -> None:
        assert stamp is not None
        if stamp.time_ns > 0:  # the second tick is the first that is scheduled
            time_s = stamp.time_ns / 1e9
            ticks.append((time_s, time.monotonic() - time_s))

    with running(SCENARIO) as stack, closing(ZenohBus(stack.scenario.bus, lossless=True)) as bus:
        bus.subscribe(keys.CLOCK, on_clock, every=True)
        while not ticks or ticks[-1][0] < minutes * 60.0:
            if not bus.spin_once(PATIENCE_S):
                stack.supervisor.poll(0.0)
    begin_s, end_s = ticks[0][0], ticks[-1][0]
    first = min(lag for time_s, lag in ticks if time_s < begin_s + WINDOW_S)
    last = min(lag for time_s, lag in ticks if time_s > end_s - WINDOW_S)
    drift_ms = (last - first) * 1e3
    print(f"{minutes:g} min in real time: the schedule drifts {drift_ms:+.3f} ms")
    return abs(drift_ms) < DRIFT_MS
