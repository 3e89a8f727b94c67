"""The command line: `python -m mecazen`."""

from mecazen.cli import main

main()
