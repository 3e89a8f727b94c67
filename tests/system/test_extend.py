"""What docs/extend.md shows is what runs: its files are written and its commands tried."""

import re
import shlex

import pytest
from harness import ROOT, load_robot, mecazen
from mecazen.loading import load_scenario
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.board import Identity
from mecazen_hardware.link import make_board
from mecazen_tools.simulation import Simulation

TEXT = (ROOT / "docs" / "extend.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)
SHORT = ("--set", "sim.duration_s=1.0")
COMMANDS = [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All files of the page."""
    made = tmp_path_factory.mktemp("extend")
    for kind, block in BLOCKS:
        if kind != "sh":
            (made / block.partition("\n")[0].removeprefix("# ")).write_text(block)
    return made


def test_each_section_is_one_screen():
    for section in TEXT.split("\n## ")[1:]:
        assert len(section.splitlines()) <= 75, section.partition("\n")[0]


@pytest.mark.parametrize("line", [line for line in COMMANDS if "mecazen up" not in line])
def test_a_command_of_the_page_works(folder, line):
    words = shlex.split(line)[1:]
    short = SHORT if words[0] == "simulate" else ()
    done = mecazen(*words, *short, folder=folder)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_board_of_the_page_takes_speeds_and_reports_angles(folder):
    scenario = folder / "board.toml"
    scenario.write_text('robot = "nexus"\n[hardware]\nboard = "my_board.py:MyBoard"\n')
    board = make_board(load_scenario(scenario).hardware, load_robot())
    sent, made = board.drive(WheelSpeeds(1.0, 2.0, 3.0, 400.0))
    assert max(made) == load_robot().wheels.max_speed_rad_s
    name, wheels = board.feed(b"mine 1\n0.5 1 1.5 2\nno number\n1 2 3")
    assert (name, board.frames, board.refused) == (Identity("mine 1"), 1, 1)
    assert wheels.angles == (0.5, 1.0, 1.5, 2.0)
    assert sent == b"%.3f %.3f %.3f %.3f\n" % made


def test_the_driver_of_a_robot_moves_it_and_stops_when_nobody_commands(folder):
    assert any("mecazen up my_hardware.toml" in line for line in COMMANDS)
    moved = []
    with Simulation(load_scenario(folder / "my_hardware.toml")) as sim:
        for tick, _ in enumerate(sim.ticks(3.0)):
            moved.append(sim.latest("odom").pose.pose.position.x)
            if tick < 100:
                sim.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    # 0.2 m/s for 1 s, and on until the command is stale, less what starting takes
    assert 0.2 < moved[-1] < 0.35
    assert moved[-1] == moved[-50]
