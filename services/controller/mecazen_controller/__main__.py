"""Runs the controller: `python -m mecazen_controller SCENARIO`."""

from mecazen.runtime import main

main("controller")
