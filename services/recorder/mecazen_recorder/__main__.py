"""Runs the recorder: `python -m mecazen_recorder SCENARIO`."""

from mecazen.runtime import main

main("recorder")
