"""A whole stack in real time under `mecazen up`: its start, its ticks, its processors, memory."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
import psutil
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario
from mecazen.messages import Clock
from mecazen.wire import Stamp
from mecazen_tools.processes import private_router

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.latency import go_first
from mecazen_bench.scenarios import SCENARIOS

WARM_S = 2.0
WINDOW_S = 5.0
START_S = 30.0

FIRST_ODOM_S = Target.below(2.0)
JITTER_MS = Target.below(1.0)
CPU_PERCENT = Target.below(25.0)
MEMORY_MB = Target.below(150.0)


class Ticks(NamedTuple):
    """What a process hears that goes before others, as the services do."""

    first_odom_s: float
    """When the first odometry came, of the monotonic clock [s]."""
    arrivals: list[tuple[float, float]]
    """Simulated time and wall time of each tick from then on [s]."""

    def jitter_ms(self) -> tuple[float, float]:
        """Return how far from the schedule ticks arrive, for half of them and for 99 % at most.

        The schedule is that of the median tick: a constant delay is none of its faults.
        """
        simulated, wall = np.array(self.arrivals).T
        late = (wall - simulated) * 1e3
        half, most = np.percentile(np.abs(late - np.median(late)), (50, 99)).tolist()
        return half, most


def _hear(scenario: Scenario, seconds: float) -> Ticks:
    """Wait for odometry, and then take ticks for some time.

    Raises:
        MecazenError: There is none.
    """
    odoms: list[float] = []
    arrivals: list[tuple[float, float]] = []

    def on_clock(clock: Clock, stamp: Stamp | None) -> None:
        del clock
        if odoms and stamp is not None:
            arrivals.append((stamp.time_ns / 1e9, time.monotonic()))

    with closing(ZenohBus(scenario.bus)) as bus:
        bus.subscribe(keys.ODOM, lambda *_: odoms.append(time.monotonic()))
        bus.subscribe(keys.CLOCK, on_clock, every=True)
        end = time.monotonic() + START_S
        while not odoms:
            if time.monotonic() > end:
                raise MecazenError("`mecazen up back` does not start")
            bus.spin_once(0.1)
        end = time.monotonic() + seconds
        while (left_s := end - time.monotonic()) > 0.0:
            bus.spin_once(left_s)
    return Ticks(odoms[0], arrivals)


def run(window_s: float = WINDOW_S) -> list[Group]:
    """Run the scenario `back` as a user does, without the viewer.

    Raises:
        MecazenError: It does not start.
    """
    settings = private_router()
    scenario = load_scenario(SCENARIOS / "back.toml", settings)
    flags = [f"--set={setting}" for setting in settings]
    begin = time.monotonic()
    up = subprocess.Popen(
        [sys.executable, "-m", "mecazen_tools", "up", "back", "--no-viewer", *flags],
        stdout=subprocess.DEVNULL,
    )
    try:
        with ProcessPoolExecutor(1, get_context("spawn"), go_first) as listener:
            first_odom_s = listener.submit(_hear, scenario, WARM_S).result().first_odom_s
            processes = _processes(up.pid)
            before = {name: _spent_s(process) for name, process in processes.items()}
            since = time.monotonic()
            ticks = listener.submit(_hear, scenario, window_s).result()
            elapsed = time.monotonic() - since
            shares = {
                name: 100.0 * (_spent_s(process) - before[name]) / elapsed
                for name, process in processes.items()
            }
            sizes = {name: process.memory_info().rss / 1e6 for name, process in processes.items()}
    finally:
        up.send_signal(signal.SIGINT)
        up.wait()
    half, most = ticks.jitter_ms()
    rows = [
        Row(
            name,
            {"% of a core": Figure.of(share, "less"), "MB": Figure.of(sizes[name], MEMORY_MB)},
        )
        for name, share in shares.items()
    ]
    rows.append(Row("all", {"% of a core": Figure.of(sum(shares.values()), CPU_PERCENT)}))
    schedule = {
        "first odom s": Figure.of(first_odom_s - begin, FIRST_ODOM_S),
        "tick off schedule, median ms": Figure.of(half, "less"),
        "p99 ms": Figure.of(most, JITTER_MS),
    }
    where = "scenario back in real time, under `mecazen up --no-viewer`"
    return [
        Group(f"A stack: {where}", f"over {window_s:g} s; resident memory", tuple(rows)),
        Group(
            f"Its start and its schedule: {where}",
            "from the command to the first `odom`; `clock` as another process sees it",
            (Row("up", schedule),),
        ),
    ]


def _processes(pid: int) -> dict[str, psutil.Process]:
    """Return the processes of an `up`, by the name of the part, and itself."""
    up = psutil.Process(pid)
    # python -m mecazen.runtime NAME …
    return {child.cmdline()[3]: child for child in up.children()} | {"up": up}


def _spent_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
