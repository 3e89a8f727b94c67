"""The machine that figures come from, and the load of other processes on it."""

from __future__ import annotations

import os
import platform
import re
import time
from collections import defaultdict
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import psutil

LIBRARIES = ("dartpy", "mujoco", "eclipse-zenoh", "msgspec", "numpy")
BUSIEST = 5
"""How many other processes are named ..."""
LEAST_SHARE = 0.01
"""... if they take this share of a core."""


class Machine(msgspec.Struct, frozen=True):
    """Hardware and software that a figure depends on."""

    cpu: str
    cores: int
    """Cores that this process may run on."""
    kernel: str
    python: str
    libraries: dict[str, str]

    @classmethod
    def here(cls) -> Machine:
        """Return this machine."""
        libraries = {}
        for name in LIBRARIES:
            with suppress(PackageNotFoundError):
                libraries[name] = version(name)
        cpuinfo = Path("/proc/cpuinfo").read_text()
        model = re.search(r"^model name\s*:\s*(.+)$", cpuinfo, re.MULTILINE)
        return cls(
            cpu=model[1].strip() if model else platform.machine(),
            cores=len(os.sched_getaffinity(0)),
            kernel=".".join(platform.release().split(".")[:2]),
            python=platform.python_version(),
            libraries=libraries,
        )

    @property
    def name(self) -> str:
        """Processor and cores as a file name."""
        # some processors include their clock frequency
        words = re.sub(r"\((r|tm)\)|@.*", " ", self.cpu.lower())
        return f"{re.sub(r'[^a-z0-9]+', '-', words).strip('-')}-{self.cores}-cores"

    def __str__(self) -> str:
        """Return the machine in one line."""
        libraries = ", ".join(f"{name} {found}" for name, found in self.libraries.items())
        system = f"Linux {self.kernel}, Python {self.python}"
        return f"{self.cpu}, {self.cores} cores; {system}, {libraries}"


class OtherLoad(msgspec.Struct, frozen=True):
    """The load of other processes during the measurement: it makes figures worse."""

    load: tuple[float, float, float]
    """Load averages over 1, 5 and 15 minutes before the measurement."""
    cores: float
    """Cores that others kept busy, on average."""
    busiest: dict[str, float]
    """Of these cores, by the name of the process."""

    def __str__(self) -> str:
        """Return it in one line."""
        load = " ".join(f"{value:.2f}" for value in self.load)
        names = ", ".join(f"{name} {share:.2f}" for name, share in self.busiest.items())
        text = f"load before {load}; other processes took {self.cores:.2f} cores meanwhile"
        return f"{text}: {names}" if names else text


class Others:
    """Accounts for the processor time of other processes, from its creation on.

    Processes that start and end in between count in the sum, but have no name.
    """

    def __init__(self) -> None:
        self._load = os.getloadavg()
        self._begin_s, self._begin_all_s = time.monotonic(), _others_s()
        self._before = _spent_by_process()

    def so_far(self) -> OtherLoad:
        """Return the load so far."""
        elapsed = time.monotonic() - self._begin_s
        shares: defaultdict[str, float] = defaultdict(float)
        for process, spent in _spent_by_process().items():
            # a process that is new has spent all of its time meanwhile
            shares[process[0]] += (spent - self._before.get(process, 0.0)) / elapsed
        busiest = sorted(shares, key=lambda name: -shares[name])[:BUSIEST]
        # the clocks of machine and processes are not read at one instant
        cores = max(0.0, (_others_s() - self._begin_all_s) / elapsed)
        named = {name: shares[name] for name in busiest if shares[name] >= LEAST_SHARE}
        return OtherLoad(self._load, cores, named)


def _spent_by_process() -> dict[tuple[str, int, float], float]:
    """Return the processor time [s] of others by name, process number and creation time."""
    me = psutil.Process()
    own = {me.pid, *(child.pid for child in me.children(recursive=True))}
    return {
        (process.info["name"], process.pid, process.info["create_time"]): sum(spent[:2])
        for process in psutil.process_iter(["name", "create_time", "cpu_times"])
        if process.pid not in own and (spent := process.info["cpu_times"]) is not None
    }


def _others_s() -> float:
    """Return the processor time of all others [s]; a hypervisor's other guests are included."""
    machine = psutil.cpu_times()
    # guest is in user already
    busy = machine.user + machine.nice + machine.system + machine.irq + machine.softirq
    own = sum(os.times()[:4])  # with the children that have ended
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            own += sum(child.cpu_times()[:2])
    return float(busy + machine.steal - own)
