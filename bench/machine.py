"""The machine that figures come from, and what else it does."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
from rich.table import Table

LIBRARIES = ("dartpy", "mujoco", "eclipse-zenoh", "msgspec", "numpy")


class Machine(msgspec.Struct, frozen=True):
    """Hardware and software that a figure depends on."""

    cpu: str
    cores: int
    """Cores that this process may run on."""
    kernel: str
    python: str
    libraries: dict[str, str]
    load: tuple[float, float, float]
    """Load averages over 1, 5 and 15 minutes before the run: more than 0 is others' work."""

    @classmethod
    def here(cls) -> Machine:
        """Return this machine as it is now."""
        return cls(
            cpu=_cpu(),
            cores=len(os.sched_getaffinity(0)),
            kernel=platform.release(),
            python=platform.python_version(),
            libraries={name: found for name in LIBRARIES if (found := _version(name))},
            load=os.getloadavg(),
        )

    def table(self) -> Table:
        """Return the machine for the terminal."""
        table = Table(title="Machine", title_justify="left", show_header=False)
        table.add_row("CPU", f"{self.cpu}, {self.cores} cores")
        table.add_row("software", f"Linux {self.kernel}, Python {self.python}")
        table.add_row("libraries", ", ".join(f"{k} {v}" for k, v in self.libraries.items()))
        table.add_row("load before the run", " ".join(f"{value:.2f}" for value in self.load))
        return table


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
