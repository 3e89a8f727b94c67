"""The command line: `mecazen --help`."""

from mecazen.cli.app import main

__all__ = ["main"]
