"""Runs the viewer: `python -m mecazen_viewer SCENARIO`."""

from mecazen.runtime import main

main("viewer")
