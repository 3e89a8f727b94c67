"""The machine that figures come from, and the load of other processes on it."""

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
        libraries = ", ".join(f"{name} {found}" for name, found in self.libraries.items())
        system = f"Linux {self.kernel}, Python {self.python}"
        return f"{self.cpu}, {self.cores} cores; {system}, {libraries}"


class OtherLoad(msgspec.Struct, frozen=True):
    """The load of other processes during the measurement: it makes figures worse."""

    load: tuple[float, float, float]
    """Load averages over 1, 5 and 15 minutes before the measurement."""
    cores: float
    """Cores that others kept busy, on average."""

    def __str__(self) -> str:
        load = " ".join(f"{value:.2f}" for value in self.load)
        return f"load before {load}; other processes took {self.cores:.2f} cores meanwhile"


class Others:
    """Accounts for the processor time of other processes, from its creation on."""

    def __init__(self) -> None:
        self._load = os.getloadavg()
        self._begin_s, self._begin_others_s = time.monotonic(), _others_s()

    def so_far(self) -> OtherLoad:
        elapsed = time.monotonic() - self._begin_s
        # the clocks of machine and processes are not read at one instant
        cores = max(0.0, (_others_s() - self._begin_others_s) / elapsed)
        return OtherLoad(self._load, cores)


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
