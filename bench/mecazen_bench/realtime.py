"""Real time: start and schedule under `mecazen up`, processor time and memory, also of a viewer."""

from __future__ import annotations

import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from multiprocessing import get_context

import numpy as np
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.messages import Clock, Odometry
from mecazen.wire import NS_PER_S, Stamp

from mecazen_bench.harness import Tables
from mecazen_bench.processes import running, set_priority, spent_s, spin, spin_until

WARM_S = 2.0
WINDOW_S = 5.0


def run(window_s: float = WINDOW_S) -> Tables:
    """Run `back` as a user does, and `side` with a viewer to which no browser is attached."""
    return {
        **_measure("back", (), window_s),
        **_measure("side", ("viewer.web_port=0", "viewer.data_port=0"), window_s),
    }


def _measure(name: str, viewer: tuple[str, ...], window_s: float) -> Tables:
    """Measure a scenario; `viewer` are the settings of a viewer, if there is one."""
    with ProcessPoolExecutor(1, get_context("spawn"), set_priority) as receiver:
        receiver.submit(os.getpid).result()  # exclude the receiver's start
        begin = time.monotonic()
        with running(name, *viewer, shows=bool(viewer)) as stack:
            first_odom_s, _ = receiver.submit(_receive, stack.scenario, WARM_S).result()
            if viewer:
                with closing(ZenohBus(stack.scenario.bus)) as bus:
                    # Rerun's server is a process of the viewer's
                    spin_until(
                        bus,
                        lambda: any(
                            child.name() == "viewer" and child.children()
                            for child in stack.up.children(recursive=True)
                        ),
                        "the viewer does not serve",
                    )
            processes, since = stack.processes(), time.monotonic()
            before = {name: spent_s(process) for name, process in processes.items()}
            _, late_ms = receiver.submit(_receive, stack.scenario, window_s).result()
            elapsed = time.monotonic() - since
            rows = {
                name: {
                    "% of a core": (100.0 * (spent_s(process) - before[name]) / elapsed, "less"),
                    # shared memory is divided among the processes
                    "MB": (process.memory_full_info().pss / 1e6, "less"),
                }
                for name, process in processes.items()
            }
    rows["all"] = {
        column: (sum(row[column][0] for row in rows.values()), "less")
        for column in ("% of a core", "MB")
    }
    half, most = np.percentile(np.abs(late_ms), (50, 99)).tolist()
    title = f"scenario {name}{', with viewer' if viewer else ''}"
    schedule = {
        "first odom s": (first_odom_s - begin, "less"),
        "tick off schedule, median ms": (half, "less"),
        "p99 ms": (most, "less"),
    }
    return {f"Processes: {title}": rows, f"Start and schedule: {title}": {"mecazen up": schedule}}


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
        spin_until(bus, lambda: odoms, "the scenario does not start")
        spin(bus, seconds)
    return min(odoms), (np.array(ticks) - np.median(ticks)).tolist()
