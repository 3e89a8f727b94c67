"""Settings of every project's tests, and what several of them need: a scenario, a router."""

import shutil
import signal

import pytest
from harness import ROBOTS
from hypothesis import HealthCheck, settings
from mecazen.bus import ports
from mecazen.bus.session import open_session
from mecazen.config import BusConfig
from mecazen.loading import load_scenario

# a shared core may be slow: examples are limited in number, not in time; and the same each time,
# so that a change is not refused for what it did not touch
settings.register_profile(
    "mecazen", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("mecazen")

# A process that a shell starts in the background ignores Ctrl-C, and hands that on: those that the
# tests start and interrupt would never end.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--scale", type=int, default=1, help="make long tests this often as long")
    parser.addoption("--log", help="file to which kills and freezes are added; those in it count")


@pytest.fixture
def scale(request):
    """By how much long tests take longer than by default."""
    return request.config.getoption("--scale")


@pytest.fixture
def write_scenario(tmp_path):
    """Write a scenario into `scenarios/`, beside `robots/nexus.toml`; return its path."""
    for folder in ("robots", "scenarios"):
        (tmp_path / folder).mkdir()
    shutil.copy(ROBOTS / "nexus.toml", tmp_path / "robots" / "nexus.toml")

    def write(text="", robot='robot = "../robots/nexus.toml"\n'):
        path = tmp_path / "scenarios" / "test.toml"
        path.write_text(robot + text)
        return path

    return write


@pytest.fixture
def scenario(write_scenario):
    return load_scenario(write_scenario("seed = 5\n"))


@pytest.fixture
def free_port():
    return ports.free_port()


@pytest.fixture(scope="session")
def router():
    """A Zenoh router on loopback; its endpoint."""
    endpoint = f"tcp/127.0.0.1:{ports.free_port()}"
    with open_session(BusConfig(connect=(endpoint,)), "router"):
        yield endpoint
