import pytest
from harness import load_robot
from mecazen.robot import Robot


@pytest.fixture(params=["nexus", "artbul", "slant"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


@pytest.fixture
def nexus() -> Robot:
    return load_robot("nexus")
