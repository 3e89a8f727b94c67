"""Real time: start and schedule under `mecazen up`, processor time and memory, also of a viewer."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager
from multiprocessing import get_context

import numpy as np
import psutil
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process, Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Clock, Odometry
from mecazen.wire import NS_PER_S, Stamp
from mecazen_tools.processes import private_router

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.latency import set_priority
from mecazen_bench.stack import SCENARIOS, START_S, Usage, running, spin, spin_until

WARM_S = 2.0
WINDOW_S = 5.0
VIEWER_WINDOW_S = 6.0
"""Duration of the viewer's measurement; the warm-up before it takes a quarter of this time."""

FIRST_ODOM_S: Goal = (None, 0.6)
JITTER_MS: Goal = (None, 1.0)
CPU_PERCENT: Goal = (None, 25.0)
MEMORY_MB: Goal = (None, 150.0)
STACK_MEMORY_MB: Goal = (None, 180.0)
VIEWER_CPU_PERCENT: Goal = (None, 10.0)
VIEWER_MEMORY_MB: Goal = (None, 300.0)


def _receive(scenario: Scenario, seconds: float) -> tuple[float, list[float]]:
    """Return the begin of simulated time [s], and the delays of ticks in `seconds` [ms].

    Times are those of the monotonic clock, in a process with the services' priority. Delays are
    relative to the median tick: a constant delay does not count. The begin is computed from the
    stamps of odometry.
    """
    odoms: list[float] = []
    ticks: list[float] = []

    def on_odom(_: Odometry, stamp: Stamp | None) -> None:
        if stamp is not None:
            odoms.append(time.monotonic() - stamp.time_ns / NS_PER_S)

    def on_clock(_: Clock, stamp: Stamp | None) -> None:
        if odoms and stamp is not None:
            ticks.append(time.monotonic() * 1e3 - stamp.time_ns / 1e6)

    with closing(ZenohBus(scenario.bus)) as bus:
        bus.subscribe(keys.ODOM, on_odom)
        bus.subscribe(keys.CLOCK, on_clock, every=True)
        spin_until(bus, lambda: odoms, "`mecazen up back` does not start")
        spin(bus, seconds)
    return min(odoms), (np.array(ticks) - np.median(ticks)).tolist()


def run(window_s: float = WINDOW_S) -> list[Group]:
    """Run the scenario `back` as a user does, without the viewer."""
    settings = private_router()
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(settings))
    with ProcessPoolExecutor(1, get_context("spawn"), set_priority) as receiver:
        receiver.submit(os.getpid).result()  # exclude the receiver's start
        begin = time.monotonic()
        with _up(settings) as up:
            first_odom_s, _ = receiver.submit(_receive, scenario, WARM_S).result()
            # the tracker is that of `multiprocessing`
            servers = {
                "fork server" if child.children() else "tracker": child for child in up.children()
            }
            services = {child.name(): child for child in servers["fork server"].children()}
            usage = Usage(services | servers | {"up": up})
            _, late_ms = receiver.submit(_receive, scenario, window_s).result()
            rows = usage.rows(CPU_PERCENT, MEMORY_MB, STACK_MEMORY_MB)
    half, most = np.percentile(np.abs(late_ms), (50, 99)).tolist()
    schedule = {
        "first odom s": Figure(first_odom_s - begin, FIRST_ODOM_S),
        "tick off schedule, median ms": Figure(half, "less"),
        "p99 ms": Figure(most, JITTER_MS),
    }
    where = "scenario back in real time"
    load = f"under `mecazen up --no-viewer`, over {window_s:g} s; proportional memory"
    start = "from the command to the first `odom`; `clock` as another process receives it"
    return [
        Group(f"Processes: {where}", load, rows),
        Group(f"Start and schedule: {where}", start, {"mecazen up": schedule}),
    ]


def run_viewer(window_s: float = VIEWER_WINDOW_S) -> list[Group]:
    """Run the scenario `side` with a viewer to which no browser is attached."""
    with running("side", "viewer.web_port=0", "viewer.data_port=0") as stack:
        stack.supervisor.start(Process(("viewer",)))
        lines = iter(lambda: stack.supervisor.poll(START_S), None)
        if not any(line.is_address for line in lines):
            raise MecazenError("the viewer does not serve")
        with closing(ZenohBus(stack.scenario.bus, "client")) as bus:
            bus.subscribe(keys.CLOCK, lambda *_: None)
            spin(bus, window_s / 4)
            service = stack.processes()["viewer"]
            usage = Usage({"service": service, "Rerun's server": service.children()[0]})
            spin(bus, window_s)
            rows = usage.rows(VIEWER_CPU_PERCENT, "less", VIEWER_MEMORY_MB)
    how = f"real time, 30 frames a second, no browser; over {window_s:g} s; proportional memory"
    return [Group("Viewer: scenario side", how, rows)]


@contextmanager
def _up(settings: tuple[str, ...]) -> Iterator[psutil.Process]:
    flags = [f"--set={setting}" for setting in settings]
    up = subprocess.Popen(
        [sys.executable, "-m", "mecazen_tools", "up", "back", "--no-viewer", *flags],
        stdout=subprocess.DEVNULL,
    )
    try:
        yield psutil.Process(up.pid)
    finally:
        up.send_signal(signal.SIGINT)
        up.wait()
