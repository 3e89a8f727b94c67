"""Real time while one client floods the bus: does the loop keep its time, and its memory?"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario
from mecazen.messages import Clock, Empty, JointState
from mecazen.wire import JSON_ENCODING, MAX_PAYLOAD_BYTES, Stamp
from mecazen_tools import certificates
from mecazen_tools.processes import Supervisor, private_router

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.scenarios import SCENARIOS

WINDOW_S = 10.0
START_S = 30.0
SECURE = SCENARIOS.parent / "zenoh" / "secure.json5"
RATE_HZ = 10_000
EVERY_KEY = (
    *(topic.key for topic in keys.TOPICS if "*" not in topic.key),
    *(call.key for call in keys.CALLS),
    "diagnostics/physics",
    "of/ones/own",
)

P99_MS = Target.below(10.0)
GROWTH_MB = Target.below(32.0)
"""Of any one process: what may wait at most, on all its keys."""


class Flood(NamedTuple):
    """What a client puts, over and over."""

    keys: Sequence[str] = ()
    payload: bytes = b""
    rate_hz: float | None = None
    """Nothing else holds it up but the bus itself where there is none."""
    secure: bool = False
    """Whether there is access control, and the client has a viewer's certificate."""


FLOODS = {
    "quiet": Flood(),
    f"cmd_vel at {RATE_HZ} Hz": Flood(("cmd_vel",), b'{"linear":{"x":0.1}}', RATE_HZ),
    "1 MiB on every key": Flood(EVERY_KEY, bytes(MAX_PAYLOAD_BYTES)),
    "quiet, access control": Flood(secure=True),
    f"cmd_vel at {RATE_HZ} Hz, denied": Flood(
        ("cmd_vel",), b'{"linear":{"x":0.1}}', RATE_HZ, secure=True
    ),
    "1 MiB on every key, denied": Flood(EVERY_KEY, bytes(MAX_PAYLOAD_BYTES), secure=True),
}


class Watch:
    """The time from each tick's clock to the command of its wheels, as another process sees it."""

    def __init__(self, bus: ZenohBus) -> None:
        self.latencies_ms: list[float] = []
        self._clocks: dict[Stamp, float] = {}
        bus.subscribe(keys.CLOCK, self._on_clock, every=True)
        bus.subscribe(keys.JOINT_COMMAND, self._on_command, every=True)

    def _on_clock(self, clock: Clock, stamp: Stamp | None) -> None:
        del clock
        if stamp is not None:
            self._clocks[stamp] = time.perf_counter()

    def _on_command(self, joints: JointState, stamp: Stamp | None) -> None:
        del joints
        begin = None if stamp is None else self._clocks.pop(stamp, None)
        if begin is not None:  # the first command of a tick: what is later only betters it
            self.latencies_ms.append((time.perf_counter() - begin) * 1e3)


def run(window_s: float = WINDOW_S) -> list[Group]:
    """Run the scenario `back` under each flood."""
    rows = []
    for name, flood in FLOODS.items():
        with tempfile.TemporaryDirectory() as folder:
            rows.append(Row(name, measure(flood, window_s, Path(folder) / "keys")))
    how = (
        f"from `clock` to `joint_command` of each tick of 10 ms, for {window_s:g} s, and the "
        "largest growth of a service's memory; one client floods through the router"
    )
    return [Group("Floods: scenario back in real time", how, tuple(rows))]


def measure(flood: Flood, window_s: float, folder: Path) -> dict[str, Figure]:
    """Return the figures of one flood; certificates, where needed, are made in `folder`."""
    settings: tuple[str, ...] = private_router("tls" if flood.secure else "tcp")
    if flood.secure:
        certificates.create(folder)
        settings = (*settings, f"bus.zenoh_config={SECURE}", f"bus.keys={folder}")
    path = SCENARIOS / "back.toml"
    scenario = load_scenario(path, settings)
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        with closing(ZenohBus(scenario.bus)) as bus:
            watch = Watch(bus)
            for part in scenario.services:
                supervisor.start(part)
            _spin(bus, START_S, watch)
            with _flooding(flood, scenario.bus) as sent:
                _spin(bus, 1.0)  # until queues and caches are as they stay
                before = _memory(supervisor)
                missed = bus.call(keys.SIM_STATE, Empty()).missed_deadlines
                watch.latencies_ms.clear()
                puts = sent.value
                _spin(bus, window_s)
                missed = bus.call(keys.SIM_STATE, Empty()).missed_deadlines - missed
                rate = (sent.value - puts) / window_s
                after = _memory(supervisor)
            supervisor.poll(0.0)
    finally:
        supervisor.stop()
    median, p99 = np.percentile(watch.latencies_ms, (50, 99)).tolist()
    growth = max(after[name] - before[name] for name in before)
    return {
        "puts/s": Figure.of(rate, "more"),
        "median ms": Figure.of(median, "less"),
        "p99 ms": Figure.of(p99, P99_MS),
        "ticks missed %": Figure.of(100 * missed / (100 * window_s), "less"),
        "growth MB": Figure.of(growth, GROWTH_MB),
    }


def _spin(bus: ZenohBus, seconds: float, until: Watch | None = None) -> None:
    """Take what comes for some time, or until a watch has seen a tick answered.

    Raises:
        MecazenError: It has not.
    """
    end = time.perf_counter() + seconds
    while (left_s := end - time.perf_counter()) > 0.0:
        bus.spin_once(left_s)
        if until is not None and until.latencies_ms:
            return
    if until is not None:
        raise MecazenError("no tick is answered")


def _memory(supervisor: Supervisor) -> dict[str, float]:
    return {
        name: psutil.Process(pid).memory_info().rss / 1e6 for name, pid in supervisor.pids.items()
    }


@contextmanager
def _flooding(
    flood: Flood, config: BusConfig
) -> Iterator[multiprocessing.sharedctypes.Synchronized[int]]:
    """Flood by another process meanwhile; yield how often it has put."""
    context = multiprocessing.get_context("spawn")
    sent, stop = context.Value("q", 0), context.Event()
    process = context.Process(target=_flood, args=(flood, config, sent, stop))
    if flood.keys:
        process.start()
    try:
        yield sent
    finally:
        stop.set()
        if flood.keys:
            process.join()


def _flood(
    flood: Flood,
    config: BusConfig,
    sent: multiprocessing.sharedctypes.Synchronized[int],
    stop: Event,
) -> None:
    with closing(ZenohBus(config, "client", name="viewer")) as bus:
        begin = time.perf_counter()
        count = 0
        while not stop.is_set():
            for key in flood.keys:
                bus.put_bytes(key, flood.payload, JSON_ENCODING)
            count += len(flood.keys)
            sent.value = count
            if flood.rate_hz is not None:
                time.sleep(max(0.0, begin + count / flood.rate_hz - time.perf_counter()))
