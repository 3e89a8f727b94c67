"""The command line: `mecazen --help`."""

from mecazen_tools.cli.app import main

__all__ = ["main"]
