from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec
import pytest
from mecazen.robot import Robot

ROBOTS = Path(__file__).parents[2] / "configs" / "robots"


def load_robot(name: str) -> Robot:
    return msgspec.convert(tomllib.loads((ROBOTS / f"{name}.toml").read_text()), Robot)


@pytest.fixture(params=["nexus", "artbul"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


@pytest.fixture
def nexus() -> Robot:
    return load_robot("nexus")
