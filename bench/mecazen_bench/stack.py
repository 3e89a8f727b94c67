"""A scenario's services as processes, and their use of processor and memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from time import clock_gettime
from typing import NamedTuple

import psutil
from mecazen import keys
from mecazen.bus import Bus
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process, Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty
from mecazen.robot import Robot
from mecazen.robots import join_key
from mecazen_tools.processes import Supervisor, private_router

from mecazen_bench.harness import Figure, Goal, Rows

SCENARIOS = Path(__file__).parents[2] / "configs" / "scenarios"
CPU = "% of a core"
START_S = 90.0
"""Timeout of a start, far longer than any process needs."""


def robot(name: str) -> Robot:
    """Return the robot of `configs/robots/<name>.toml`."""
    return load_scenario(SCENARIOS / "back.toml", {"robot": name}).robot


class Stack(NamedTuple):
    """A scenario with running services."""

    scenario: Scenario
    supervisor: Supervisor

    def processes(self) -> dict[str, psutil.Process]:
        """Return all processes, including the router, by name."""
        return {name: psutil.Process(pid) for name, pid in self.supervisor.pids.items()}


@contextmanager
def running(
    name: str,
    *settings: str,
    services: Sequence[str] | None = None,
) -> Iterator[Stack]:
    """Run a router and a scenario's services, or some of them, isolated from any other run."""
    path = SCENARIOS / f"{name}.toml"
    settings = (*settings, *private_router())
    scenario = load_scenario(path, parse_settings(settings))
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        apart = None if services is None else [Process((service,)) for service in services]
        for process in scenario.process_plan if apart is None else apart:
            supervisor.start(process)
        yield Stack(scenario, supervisor)
        supervisor.poll(0.0)
    finally:
        supervisor.stop()


@contextmanager
def paused(stack: Stack) -> Iterator[ZenohBus]:
    """Pause a stack once all its services are ready, and yield a bus on which to resume it."""
    ready = {join_key(f"{service}/ready", robot) for service, robot in stack.scenario.parts}
    with closing(ZenohBus(stack.scenario.bus, "client")) as bus:
        spin_until(bus, lambda: bus.alive() >= ready, "the services do not start")
        bus.call(keys.SIM_PAUSE, Empty())
        yield bus


def spin(bus: Bus, seconds: float) -> None:
    """Deliver incoming messages for some time."""
    end = time.perf_counter() + seconds
    while (left_s := end - time.perf_counter()) > 0.0:
        bus.spin_once(left_s)


def spin_until(bus: Bus, condition: Callable[[], object], failure: str) -> None:
    """Deliver incoming messages until a condition holds."""
    end = time.perf_counter() + START_S
    while not condition():
        if time.perf_counter() > end:
            raise MecazenError(failure)
        bus.spin_once(0.1)


class Usage:
    """Processor time of processes since the creation of this object, and their memory."""

    def __init__(self, processes: Mapping[str, psutil.Process]) -> None:
        self._processes = processes
        self._begin_s = time.perf_counter()
        self._before = {name: spent_s(process) for name, process in processes.items()}

    def core_percent(self) -> dict[str, float]:
        """Return the share of a core that each process has used so far [%]."""
        elapsed = time.perf_counter() - self._begin_s
        return {
            name: 100.0 * (spent_s(process) - self._before[name]) / elapsed
            for name, process in self._processes.items()
        }

    def memory_mb(self) -> dict[str, float]:
        """Return the memory of each process [MB]; shared memory is divided among the processes."""
        return {
            name: process.memory_full_info().pss / 1e6 for name, process in self._processes.items()
        }

    def rows(self, cpu: Goal, memory: Goal, total: Goal | None = None) -> Rows:
        """Return time and memory per process, and their sums with goals; `total` in MB."""
        taken, used = self.core_percent(), self.memory_mb()
        rows = {
            name: {CPU: Figure(taken[name], "less"), "MB": Figure(mb, memory)}
            for name, mb in used.items()
        }
        rows["all"] = {CPU: Figure(sum(taken.values()), cpu)}
        if total is not None:
            rows["all"]["MB"] = Figure(sum(used.values()), total)
        return rows


def spent_s(process: psutil.Process) -> float:
    """Return the processor time that a process has used [s]."""
    return clock_gettime(~process.pid << 3 | 2)  # the clock of clock_getcpuclockid
