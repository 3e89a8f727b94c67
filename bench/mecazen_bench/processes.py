"""A scenario under `mecazen up`, as the subject of a benchmark: its processes and their use."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import clock_gettime
from typing import NamedTuple

import psutil
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.processes import private_router

SCENARIOS = Path(__file__).parents[2] / "configs" / "scenarios"
HELPERS = ("up", "fork server", "tracker")
"""Processes that neither compute nor carry messages."""
START_S = 90.0
"""Timeout of a start, far longer than any process needs."""


class Stack(NamedTuple):
    """A running scenario."""

    scenario: Scenario
    up: psutil.Process

    def processes(self) -> dict[str, psutil.Process]:
        """Return all processes by name: services, router and viewer, and `HELPERS`."""
        named = {"up": self.up}
        for child in self.up.children(recursive=True):
            if child.ppid() != self.up.pid:
                name = child.name()
                named[name if name not in named else f"{name} {child.pid}"] = child
            else:  # the tracker is that of `multiprocessing`
                named["fork server" if child.children() else "tracker"] = child
        return named


@contextmanager
def running(name: str, *settings: str, shows: bool = False) -> Iterator[Stack]:
    """Run a scenario as a user does, isolated from any other run; `shows` adds the viewer."""
    settings = (*settings, *private_router())
    scenario = load_scenario(SCENARIOS / f"{name}.toml", parse_settings(settings))
    flags = [f"--set={setting}" for setting in settings] + ["--no-viewer"] * (not shows)
    up = subprocess.Popen(
        [sys.executable, "-m", "mecazen_tools", "up", name, *flags], stdout=subprocess.DEVNULL
    )
    try:
        yield Stack(scenario, psutil.Process(up.pid))
    finally:
        up.send_signal(signal.SIGINT)
        up.wait()


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


def spent_s(process: psutil.Process) -> float:
    """Return the processor time that a process has used [s]."""
    return clock_gettime(~process.pid << 3 | 2)  # the clock of clock_getcpuclockid


def set_priority() -> None:
    """Set the real-time priority of the services; see `mecazen.runtime.process`."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))
