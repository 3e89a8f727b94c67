"""Runs the target: `python -m mecazen_target SCENARIO`."""

from mecazen.runtime import main

main("target")
