"""Where the scenarios lie, and the robots in them."""

from __future__ import annotations

from pathlib import Path

from mecazen.loading import load_scenario
from mecazen.robot import Robot

SCENARIOS = Path(__file__).parents[2] / "configs" / "scenarios"


def robot(name: str) -> Robot:
    """Return the robot of `configs/robots/<name>.toml`."""
    return load_scenario(SCENARIOS / "back.toml", (f'robot="../robots/{name}.toml"',)).robot
