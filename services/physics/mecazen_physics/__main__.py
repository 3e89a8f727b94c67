"""Runs the physics: `python -m mecazen_physics SCENARIO`."""

from mecazen.runtime import main

main("physics")
