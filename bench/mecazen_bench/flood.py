"""Real time while one client floods the bus: latency of ticks, and memory."""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.messages import Clock, Empty, JointState
from mecazen.wire import JSON_ENCODING, MAX_PAYLOAD_BYTES, Stamp
from mecazen_tools import certificates

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.stack import SCENARIOS, Usage, running, spin, spin_until

WINDOW_S = 10.0
SECURE = SCENARIOS.parent / "zenoh" / "secure.json5"
RATE_HZ = 10_000
EVERY_KEY = (
    *(topic.key for topic in keys.TOPICS if "*" not in topic.key),
    *(call.key for call in keys.CALLS),
    "diagnostics/physics",
    "of/ones/own",
)

P99_MS = Target(high=10.0)
GROWTH_MB = Target(high=32.0)
"""Of any one process: the limit of what waits on all its keys."""


class Flood(NamedTuple):
    """What a client puts repeatedly."""

    keys: Sequence[str] = ()
    payload: bytes = b""
    rate_hz: float | None = None
    """None for as fast as the bus takes it."""


QUIET = Flood()
FAST = Flood(("cmd_vel",), b'{"linear":{"x":0.1}}', RATE_HZ)
LARGE = Flood(EVERY_KEY, bytes(MAX_PAYLOAD_BYTES))
FLOODS = {
    "quiet": (QUIET, False),
    f"cmd_vel at {RATE_HZ} Hz": (FAST, False),
    "1 MiB on every key": (LARGE, False),
    "quiet, access control": (QUIET, True),
    f"cmd_vel at {RATE_HZ} Hz, denied": (FAST, True),
    "1 MiB on every key, denied": (LARGE, True),
}
"""Floods, and whether there is access control and the client has a viewer's certificate."""


class Watch:
    """Measures the time from each tick's clock to its joint command, in another process."""

    def __init__(self, bus: ZenohBus) -> None:
        self.latencies_ms: list[float] = []
        self._clocks: dict[Stamp, float] = {}
        bus.subscribe(keys.CLOCK, self._on_clock, every=True)
        bus.subscribe(keys.JOINT_COMMAND, self._on_command, every=True)

    def _on_clock(self, _: Clock, stamp: Stamp | None) -> None:
        if stamp is not None:
            self._clocks[stamp] = time.perf_counter()

    def _on_command(self, _: JointState, stamp: Stamp | None) -> None:
        begin = None if stamp is None else self._clocks.pop(stamp, None)
        if begin is not None:  # the first command of a tick; later ones only improve it
            self.latencies_ms.append((time.perf_counter() - begin) * 1e3)


def run(window_s: float = WINDOW_S) -> list[Group]:
    """Run the scenario `back` under each flood."""
    cases = FLOODS.items()
    rows = [Row(name, measure(flood, window_s, secure=secure)) for name, (flood, secure) in cases]
    how = (
        f"from `clock` to `joint_command` of each tick of 10 ms, for {window_s:g} s, and the "
        "largest growth of a service's memory; one client floods through the router"
    )
    return [Group("Floods: scenario back in real time", how, tuple(rows))]


def measure(flood: Flood, window_s: float, *, secure: bool) -> dict[str, Figure]:
    """Return the figures of one flood, with access control where it is to be `secure`."""
    protocol: Literal["tcp", "tls"] = "tls" if secure else "tcp"
    settings: tuple[str, ...] = ()
    with tempfile.TemporaryDirectory() as folder:
        if secure:
            certificates.create(Path(folder) / "keys")
            settings = (f"bus.zenoh_config={SECURE}", f"bus.keys={folder}/keys")
        with (
            running("back", *settings, protocol=protocol) as stack,
            closing(ZenohBus(stack.scenario.bus)) as bus,
        ):
            watch = Watch(bus)
            spin_until(bus, lambda: watch.latencies_ms, "no tick is answered")
            with _flooding(flood, stack.scenario.bus) as sent:
                if flood.keys:
                    spin_until(bus, lambda: sent.value, "the flood does not begin")
                spin(bus, 1.0)  # until queues and caches are full
                usage = Usage(stack.processes())
                before, puts = usage.memory_mb(), sent.value
                missed = -bus.call(keys.SIM_STATE, Empty()).missed_deadlines
                watch.latencies_ms.clear()
                spin(bus, window_s)
                missed += bus.call(keys.SIM_STATE, Empty()).missed_deadlines
                rate = (sent.value - puts) / window_s
                # under load answers may come late, but they come
                spin_until(bus, lambda: watch.latencies_ms, "no tick is answered")
                growth = max(mb - before[name] for name, mb in usage.memory_mb().items())
    median, p99 = np.percentile(watch.latencies_ms, (50, 99)).tolist()
    ticks = window_s / stack.scenario.sim.tick_s
    return {
        "puts/s": Figure.of(rate, "more"),
        "median ms": Figure.of(median, "less"),
        "p99 ms": Figure.of(p99, P99_MS),
        "ticks missed %": Figure.of(100.0 * missed / ticks, "less"),
        "growth MB": Figure.of(growth, GROWTH_MB),
    }


@contextmanager
def _flooding(flood: Flood, config: BusConfig) -> Iterator[Synchronized[int]]:
    """Flood from another process; yield the number of its puts."""
    context = multiprocessing.get_context("spawn")
    sent, stop = context.Value("q", 0), context.Event()
    if not flood.keys:
        yield sent
        return
    process = context.Process(target=_flood, args=(flood, config, sent, stop))
    process.start()
    try:
        yield sent
    finally:
        stop.set()
        process.join()


def _flood(flood: Flood, config: BusConfig, sent: Synchronized[int], stop: Event) -> None:
    with closing(ZenohBus(config, "client", name="viewer")) as bus:
        begin = time.perf_counter()
        while not stop.is_set():
            for key in flood.keys:
                bus.put_bytes(key, flood.payload, JSON_ENCODING)
            sent.value += len(flood.keys)
            if flood.rate_hz is not None:
                time.sleep(max(0.0, begin + sent.value / flood.rate_hz - time.perf_counter()))
