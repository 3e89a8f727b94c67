"""Hours of simulated time: memory, ticks, and the schedule: `make soak HOURS=2`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario
from mecazen.messages import Message
from mecazen.runtime import announce_readiness
from mecazen.wire import Stamp
from mecazen_tools.processes import Supervisor, beside_that_core, on_one_core, private_router

from mecazen_bench.scenarios import SCENARIOS

WITNESS = "witness"
"""The part that counts ticks; in lockstep physics begins when it is ready, too."""
SCENARIO = SCENARIOS / "circle.toml"
"""Its person walks without end."""
EVERY_TICK = (keys.CLOCK, keys.ODOM, keys.TARGET_ODOM, keys.FOLLOWER_STATE, keys.JOINT_COMMAND)

SAMPLE_S = 60.0
"""Simulated time between two looks at memory."""
SETTLED_S = 600.0
"""After this simulated time nothing is to grow any more ..."""
GROWTH_MB = 5.0
"""... by more than this."""
DRIFT_MS = 10.0
"""At most so far a schedule may be off the wall clock at the end."""
WINDOW_S = 5.0
"""At both ends of a real-time run the soonest tick of so long counts: the others came late."""
PATIENCE_S = 0.25


class Ticks:
    """Counts what is missing or comes twice on keys that have a sample in every tick."""

    def __init__(self, bus: ZenohBus, tick_ns: int) -> None:
        self.newest = 0
        self.missed = self.repeated = 0
        self._tick_ns = tick_ns
        self._last: dict[str, int] = {}
        topics: tuple[keys.Topic[Any], ...] = EVERY_TICK
        for topic in topics:
            bus.subscribe(topic, self._counter(topic.key), every=True)

    def _counter(self, key: str) -> Callable[[Message, Stamp | None], None]:
        def count(message: Message, stamp: Stamp | None) -> None:
            del message
            assert stamp is not None
            tick = stamp.time_ns // self._tick_ns
            last = self._last.get(key, -1)
            self.missed += max(0, tick - last - 1)
            self.repeated += tick <= last
            self._last[key] = tick
            self.newest = max(self.newest, tick)

        return count


def own_mb(pid: int) -> float:
    """Return the memory that is a process's own [MB]: what it shares is counted nowhere."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    lines = [line.split() for line in rollup.splitlines()[1:]]
    return sum(int(line[1]) for line in lines if line[0].startswith("Private_")) / 1024


@contextmanager
def running(*settings: str) -> Iterator[tuple[Scenario, Supervisor, ZenohBus, Ticks]]:
    """Start the scenario with a witness; in lockstep as `mecazen simulate --distributed` does."""
    settings = (*settings, *private_router())
    parts = load_scenario(SCENARIO, settings).services
    settings = (*settings, f"services={json.dumps([*parts, WITNESS])}")
    scenario = load_scenario(SCENARIO, settings)
    lockstep = scenario.sim.mode == "lockstep"
    supervisor = Supervisor(SCENARIO, settings)
    try:
        supervisor.start_router()
        with beside_that_core() if lockstep else nullcontext():
            bus = ZenohBus(scenario.bus, lossless=True)
        with closing(bus):
            ticks = Ticks(bus, scenario.sim.tick_ns)
            bus.declare_alive(WITNESS)
            announce_readiness(bus, WITNESS, scenario)
            for part in parts:
                with on_one_core() if lockstep else nullcontext():
                    supervisor.start(part)
            yield scenario, supervisor, bus, ticks
    finally:
        supervisor.stop()


def soak(hours: float) -> bool:
    """Simulate as fast as it goes; return whether memory and ticks are as they should be."""
    with running("sim.mode=lockstep", f"sim.duration_s={hours * 3600.0}") as (
        scenario,
        supervisor,
        bus,
        ticks,
    ):
        settled: dict[str, float] = {}
        most: dict[str, float] = {}
        begin, due_s = time.monotonic(), SAMPLE_S
        while ticks.newest < scenario.sim.ticks - 1:
            if not bus.spin_once(PATIENCE_S):
                supervisor.poll(0.0)
            time_s = ticks.newest * scenario.sim.tick_s
            if time_s < due_s:
                continue
            due_s += SAMPLE_S
            memory = {name: own_mb(pid) for name, pid in supervisor.pids.items()}
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


def drift(minutes: float) -> bool:
    """Run in real time; return whether the schedule stays with the wall clock."""
    lags: list[tuple[float, float]] = []
    with running() as (_, supervisor, bus, _ticks):
        begin_s: float | None = None

        def on_clock(message: Message, stamp: Stamp | None) -> None:
            nonlocal begin_s
            del message
            assert stamp is not None
            now = time.monotonic()
            if stamp.time_ns == 0:
                return  # the second tick is the first that is due
            time_s = stamp.time_ns / 1e9
            if begin_s is None:
                begin_s = now - time_s
            lags.append((time_s, now - begin_s - time_s))

        bus.subscribe(keys.CLOCK, on_clock, every=True)
        while not lags or lags[-1][0] < minutes * 60.0:
            if not bus.spin_once(PATIENCE_S):
                supervisor.poll(0.0)
    end_s = lags[-1][0]
    first = min(lag for time_s, lag in lags if time_s < WINDOW_S)
    last = min(lag for time_s, lag in lags if time_s > end_s - WINDOW_S)
    off_ms = (last - first) * 1e3
    print(f"{minutes:g} min in real time: the schedule is {off_ms:+.3f} ms off the wall clock")
    return abs(off_ms) < DRIFT_MS


def main() -> None:
    """Soak, and say by the exit code whether all is as it should be."""
    parser = argparse.ArgumentParser(prog="python -m mecazen_bench.soak", description=__doc__)
    parser.add_argument("--hours", type=float, default=2.0, help="simulated, in lockstep")
    parser.add_argument("--minutes", type=float, default=10.0, help="in real time")
    options = parser.parse_args()
    try:
        good = [soak(options.hours), drift(options.minutes)]
    except MecazenError as error:
        sys.exit(f"error: {error}")
    if not all(good):
        sys.exit("error: not as it should be")


if __name__ == "__main__":
    main()
