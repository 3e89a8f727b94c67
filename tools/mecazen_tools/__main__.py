"""The command line: `python -m mecazen_tools`."""

from mecazen_tools.cli import main

main()
