"""The machine that figures come from, and what else it does."""

from __future__ import annotations

import os
import platform
import re
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import psutil

LIBRARIES = ("dartpy", "mujoco", "eclipse-zenoh", "msgspec", "numpy")
BUSIEST = 5
"""Other processes that are named."""
LEAST_SHARE = 0.01
"""Of a core, that a process is named for."""


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
        return cls(
            cpu=_cpu(),
            cores=len(os.sched_getaffinity(0)),
            kernel=".".join(platform.release().split(".")[:2]),
            python=platform.python_version(),
            libraries={name: found for name in LIBRARIES if (found := _version(name))},
        )

    @property
    def name(self) -> str:
        """Processor and cores as the name of a file: the same after the host is made anew."""
        # some processors give their clock, too
        words = re.sub(r"\((r|tm)\)|@.*", " ", self.cpu.lower())
        return f"{re.sub(r'[^a-z0-9]+', '-', words).strip('-')}-{self.cores}-cores"

    def text(self) -> str:
        """Return the machine in one line."""
        libraries = ", ".join(f"{name} {found}" for name, found in self.libraries.items())
        system = f"Linux {self.kernel}, Python {self.python}"
        return f"{self.cpu}, {self.cores} cores; {system}, {libraries}"


class OtherWork(msgspec.Struct, frozen=True):
    """What others did on the machine: they make figures worse."""

    load: tuple[float, float, float]
    """Load averages over 1, 5 and 15 minutes before it was measured."""
    cores: float
    """Cores that others kept busy in the mean while it was measured."""
    busiest: dict[str, float]
    """Of these cores, by the name of the process."""

    def text(self) -> str:
        """Return it in one line."""
        load = " ".join(f"{value:.2f}" for value in self.load)
        names = ", ".join(f"{name} {share:.2f}" for name, share in self.busiest.items())
        return f"load before {load}; meanwhile others took {self.cores:.2f} cores" + (
            f": {names}" if names else ""
        )


class Others:
    """Watches what other processes do, from its making on.

    What begins and ends between two looks is only in the sum of all.
    """

    def __init__(self) -> None:
        self._load = os.getloadavg()
        self._begin_s, self._begin_all_s = time.monotonic(), _processor_s()
        self._spent: dict[tuple[int, float], tuple[str, float, float]] = {}
        self._first = True
        self.look()

    def look(self) -> None:
        """See how much processor time each process has had."""
        me = psutil.Process()
        own = {me.pid, *(child.pid for child in me.children(recursive=True))}
        for process in psutil.process_iter(["name", "create_time", "cpu_times"]):
            spent = process.info["cpu_times"]
            if process.pid in own or spent is None:
                continue
            total = spent.user + spent.system
            key = (process.pid, process.info["create_time"])
            # what is new since the last look has spent all of it meanwhile
            _, before, _ = self._spent.get(key, ("", total if self._first else 0.0, 0.0))
            self._spent[key] = (process.info["name"], before, total)
        self._first = False

    def work(self) -> OtherWork:
        """Return what others have done so far."""
        self.look()
        elapsed = time.monotonic() - self._begin_s
        shares: dict[str, float] = {}
        for name, before, now in self._spent.values():
            shares[name] = shares.get(name, 0.0) + (now - before) / elapsed
        busiest = sorted(shares.items(), key=lambda item: -item[1])[:BUSIEST]
        return OtherWork(
            load=self._load,
            # the two clocks are not read at one instant
            cores=max(0.0, (_processor_s() - self._begin_all_s) / elapsed),
            busiest={name: share for name, share in busiest if share >= LEAST_SHARE},
        )


def _processor_s() -> float:
    """Return the processor time of all others; a hypervisor's other guests are some."""
    machine = psutil.cpu_times()
    # guest is in user already
    busy = machine.user + machine.nice + machine.system + machine.irq + machine.softirq
    own = sum(os.times()[:4])  # with the children that have ended
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            spent = child.cpu_times()
            own += spent.user + spent.system
    return float(busy + machine.steal - own)


def _cpu() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
