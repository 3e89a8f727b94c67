"""Errors that a user can act on: one clear line each, no traceback."""


class MecazenError(Exception):
    """A failure that is shown in one line; the process exits with `exit_code`."""

    exit_code = 1


class ConfigError(MecazenError):
    """A configuration that can't be used: file, key and what is allowed."""

    exit_code = 2


class BusError(MecazenError):
    """The bus can't be opened, or a name or a port on it is taken."""


class StepTimeoutError(MecazenError):
    """A service did not answer a tick in time."""
