"""The converter and the scenario that docs/hardware.md shows let a robot follow."""

import re
import subprocess
import sys

import pytest
from hardware.stand import emulated
from harness import COMMAND_GUARD_S, ROOT, Newest
from mecazen.keys import FOLLOWER_STATE, ODOM

PAGE = (ROOT / "docs" / "hardware.md").read_text()
FILES = re.findall(r"```\w+\n# (\w+\.\w+)\n(.*?)```", PAGE, re.DOTALL)
ENDPOINT, KEY = "tcp/127.0.0.1:7447", "target/observation"


@pytest.fixture
def folder(tmp_path):
    """The files of the page."""
    for name, text in FILES:
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.fixture
def convert(folder):
    """Run the converter of the page for the run on a bus, until the test ends."""
    text = (folder / "detector.py").read_text()
    file = folder / "detector_of_run.py"
    running = []

    def start(bus):
        assert ENDPOINT in text
        assert f'"{KEY}"' in text
        own = text.replace(ENDPOINT, bus.connect[0])
        file.write_text(own.replace(f'"{KEY}"', f'"{bus.namespace}/{KEY}"'))
        running.append(subprocess.Popen([sys.executable, file]))

    yield start
    for process in running:
        process.terminate()
        process.wait(COMMAND_GUARD_S)


@pytest.fixture
def port():
    """The port of an emulated board whose wheels turn freely."""
    with emulated() as emulator:
        yield emulator.line.name


def test_a_robot_follows_the_person_of_the_converter(stack, port, folder, convert):
    running = stack(folder / "my_x3.toml", f"hardware.port={port}")
    state, odom = Newest(running.bus, FOLLOWER_STATE), Newest(running.bus, ODOM)
    running.start()
    running.wait(lambda: state.message and odom.message)
    assert state.message.tracking == "waiting"
    convert(running.scenario.bus)
    running.wait(lambda: state.message.tracking == "following")
    # the person stays 1.5 m ahead, more than the standoff of 1 m
    running.wait(lambda: odom.pose.x > 0.1)
    assert abs(odom.pose.y) < 0.02  # straight ahead
