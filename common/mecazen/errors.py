"""Errors that a user can act on: one clear line each, no traceback."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_tb


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


class StepTimeoutError(MecazenError):
    """A service did not answer a tick in time."""


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
    frames = [f for f in extract_tb(error.__traceback__) if not _is_ours(f.filename)]
    where = " > ".join(f"{Path(f.filename).name}:{f.lineno} {f.name}" for f in frames)
    return " ".join(f"{type(error).__name__}: {error} ({where})".split())


def _is_ours(file: str) -> bool:
    return file.startswith(("<frozen", str(Path(__file__).parent)))
