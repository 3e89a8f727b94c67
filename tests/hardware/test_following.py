"""The whole loop: driver, pseudo-terminal, emulated board, physics, and back."""

import re

import pytest
from harness import Command, mecazen
from mecazen_tools.processes import private_router

STACK = 'services=["hardware","controller","follower"]'
DRIVEN_S = 8.0
"""`docs/hardware.md` has ten minutes."""


@pytest.fixture
def settings(tmp_path):
    router = [part for setting in private_router() for part in ("--set", setting)]
    return tmp_path / "board", router


def test_a_robot_behind_an_emulated_board_follows_a_person(settings):
    port, router = settings
    board = Command(
        *("hardware", "emulate", "rosmaster_x3", "back", "--link", port, "--duration", DRIVEN_S),
        *router,
    )
    board.read_until("waits for a frame")
    stack = Command(
        *("up", "back", "--no-viewer", "--set", STACK, "--set", "robot=rosmaster_x3"),
        *("--set", f"hardware.port={port}", *router),
    )
    said = board.read_until("distance error")
    board.end(None)
    # the person has walked for 7 s at 0.5 m/s; a robot that stands would be 2 m off on average
    assert float(re.search(r"distance error ([0-9.]+) m", said)[1]) < 0.3
    assert re.search(r"[0-9]{3} frames taken", board.text)
    _, _, errors = stack.end(None)
    # the emulator has ended: to the driver its port has gone
    assert "the port has gone in mid-run" in errors
    assert errors.count("\n") == 1


def test_a_cable_that_is_pulled_is_one_line_and_the_emulator_shows_the_run_away(settings):
    port, router = settings
    board = Command(
        *("hardware", "emulate", "rosmaster_x3", "back", "--link", port, "--duration", 8.0),
        *("--fault", "unplug@4", *router),
    )
    board.read_until("waits for a frame")
    stack = Command(
        *("up", "back", "--no-viewer", "--set", STACK, "--set", "robot=rosmaster_x3"),
        *("--set", f"hardware.port={port}", *router),
    )
    board.read_until("unplug")
    assert "keep their last command" in board.read_until("run-away")
    code, _, errors = stack.end(None)
    assert code == 1
    assert "the port has gone in mid-run" in errors
    board.end()


@pytest.mark.parametrize("fault", ["rust=0.1", "drop=2", "unplug@x", "delay"])
def test_a_fault_that_is_not_known_is_one_line(fault):
    done = mecazen("hardware", "emulate", "rosmaster_x3", "back", "--fault", fault)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: --fault {fault}: allowed are drop=CHANCE")
    assert done.stderr.count("\n") == 1
