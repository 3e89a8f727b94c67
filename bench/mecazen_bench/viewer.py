"""The viewer beside a run in real time: processor time and memory."""

from __future__ import annotations

import time
from contextlib import closing

import psutil
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario
from mecazen_tools.processes import Supervisor, private_router

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.scenarios import SCENARIOS

WINDOW_S = 6.0
"""Over which processor time is measured; a run is warm after a quarter of it."""
START_S = 30.0
SERVING = "msg=serving"

CPU_PERCENT = Target.below(10.0)
MEMORY_MB = Target.below(300.0)


def run(window_s: float = WINDOW_S) -> list[Group]:
    """Run the scenario `side` with a viewer that nobody looks at."""
    path = SCENARIOS / "side.toml"
    settings = ("viewer.web_port=0", "viewer.data_port=0", *private_router())
    scenario = load_scenario(path, settings)
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        for part in scenario.services:
            supervisor.start(part)
        supervisor.start("viewer")
        _wait_until_it_serves(supervisor)
        with closing(ZenohBus(scenario.bus, "client")) as bus:
            bus.subscribe(keys.CLOCK, lambda *_: None)
            _spend(bus, window_s / 4)
            service = psutil.Process(supervisor.pids["viewer"])
            both = {"service": service, "Rerun's server": service.children()[0]}
            before = {name: sum(process.cpu_times()[:2]) for name, process in both.items()}
            begin = time.perf_counter()
            _spend(bus, window_s)
            spent_s = time.perf_counter() - begin
            cpu = {
                name: 100.0 * (sum(process.cpu_times()[:2]) - before[name]) / spent_s
                for name, process in both.items()
            }
            memory = {name: process.memory_info().rss / 1e6 for name, process in both.items()}
        supervisor.poll(0.0)
    finally:
        supervisor.stop()
    rows = []
    for name in both:
        share, size = Figure.of(cpu[name], "less"), Figure.of(memory[name], "less")
        rows.append(Row(name, {"% of a core": share, "MB": size}))
    total = {
        "% of a core": Figure.of(sum(cpu.values()), CPU_PERCENT),
        "MB": Figure.of(sum(memory.values()), MEMORY_MB),
    }
    how = f"real time, 30 pictures a second, nobody attached; over {window_s:g} s; resident memory"
    return [Group("The viewer: scenario side", how, (*rows, Row("both", total)))]


def _wait_until_it_serves(supervisor: Supervisor) -> None:
    """Take the processes' lines until the viewer serves.

    Raises:
        MecazenError: It does not.
    """
    while (line := supervisor.poll(START_S)) is not None:
        if SERVING in line.text:
            return
    raise MecazenError("the viewer does not serve")


def _spend(bus: ZenohBus, seconds: float) -> None:
    """Take what comes for some time."""
    end = time.perf_counter() + seconds
    while (left_s := end - time.perf_counter()) > 0.0:
        bus.spin_once(left_s)
