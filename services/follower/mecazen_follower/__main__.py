"""Runs the follower: `python -m mecazen_follower SCENARIO`."""

from mecazen.runtime import main

main("follower")
