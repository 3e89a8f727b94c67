"""Errors of one line each, lines of logs, and the extras that are installed."""

from __future__ import annotations

import importlib.util
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_tb

LIBRARIES = {
    "physics": "dartpy",
    "sensors": "mujoco",
    "robots": "mujoco",
    "target": "scipy",
    "crowd": "scipy",
    "follower": "filterpy",
    "hardware": "serial",
    "viewer": "rerun",
    "recorder": "mcap",
    "ros2": "rosbags",
    "studies": "optuna",
    "bench": "psutil",
}
"""A library of each extra, by extra; the extra of a service has the service's name."""


def is_installed(extra: str) -> bool:
    """Return whether an extra is installed; a service without one needs nothing more."""
    return extra not in LIBRARIES or importlib.util.find_spec(LIBRARIES[extra]) is not None


class MecazenError(Exception):
    """A failure that is shown in one line; the process exits with `exit_code`."""

    exit_code = 1


class ConfigError(MecazenError):
    """A configuration that can't be used; the message names file, key and allowed values."""

    exit_code = 2


class UntrustedError(ConfigError):
    """A recording would run programs or open files, and has not been trusted."""


class BusError(MecazenError):
    """The bus can't be opened, or a name or a port on it is taken."""


class RefusedError(Exception):
    """A message that can't be used; it is raised only where a message is read."""


class NodeError(MecazenError):
    """A user node failed; the message names the node, the failed call and the place in its code."""


@contextmanager
def explaining(name: str) -> Iterator[None]:
    """Convert exceptions of user code into a NodeError that names the node and the line."""
    try:
        yield
    except (MecazenError, RefusedError):
        raise
    except Exception as error:
        raise NodeError(f"{name}: {explained(error)}") from error


def explained(error: Exception) -> str:
    """Return in one line an error of user code and its place in that code."""
    ours = ("<frozen", str(Path(__file__).parent))
    frames = [f for f in extract_tb(error.__traceback__) if not f.filename.startswith(ours)]
    where = " > ".join(f"{Path(f.filename).name}:{f.lineno} {f.name}" for f in frames)
    return " ".join(f"{type(error).__name__}: {error} ({where})".split())


def set_up_log(service: str, time_s: Callable[[], float], level: int = logging.INFO) -> None:
    """Send logs of a level and above to standard error, with simulated time [s].

    A line is `t=12.340 level=warning service=physics msg=…`.
    """

    def add_time(record: logging.LogRecord) -> bool:
        record.time_s, record.level = time_s(), record.levelname.lower()
        return True

    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(add_time)
    line = f"t=%(time_s).3f level=%(level)s service={service} %(message)s"
    handler.setFormatter(logging.Formatter(line))
    logging.basicConfig(level=level, handlers=[handler], force=True)
