"""The commands of `mecazen hardware`, on an emulated board and with a whole stack."""

import re
import time

import pytest
import typer
from hardware.stand import emulated
from harness import SCENARIOS, Command, Newest
from mecazen.errors import MecazenError
from mecazen.geometry import Pose2D
from mecazen.keys import OBSERVATION, ODOM
from mecazen.messages import Header, Observation, Pose, PoseWithCovariance
from mecazen_hardware.emulator.world import EmulatedWorld, load
from mecazen_tools.cli.hardware import app
from stack import Stack
from typer.testing import CliRunner


def run(*arguments, answers=""):
    return CliRunner().invoke(app, arguments, input=answers, standalone_mode=False)


def test_probe_shows_the_board_without_motion():
    with emulated() as emulator:
        shown = run("probe", "--port", emulator.line.name).stdout
        assert "ROSMASTER X3, firmware 3.5" in shown
        assert "battery: 12.0 V" in shown
        assert "turned: front_left 0.00 rad" in shown
        assert "WheelAngles: 2" in shown  # 24.4 Hz
        assert not any(emulator.world.angles)


def test_a_check_needs_a_yes():
    assert isinstance(run("check", answers="n\n").exception, typer.Abort)


def test_a_check_names_a_wrong_wiring_in_physics():
    # without friction wheels turn freely, as off the ground
    settings = "robot=nexus", "robot.wheels.wiring=[2,1,3,-4]", "world.ground_friction=0"
    world = EmulatedWorld(load(SCENARIOS / "teleop.toml", settings))
    with emulated(world=world) as emulator:
        # all are off the ground; of the wheel whose encoder agrees the person sees no turn
        done = run("check", "--port", emulator.line.name, answers="y\nn\n")
    assert "front_left: front_right turned instead" in done.stdout
    assert "front_right: front_left turned instead" in done.stdout
    assert "rear_left: its encoder agrees, but it did not" in done.stdout
    assert "rear_right: it counts backwards" in done.stdout
    assert str(done.exception) == "4 of 4 wheels are wrong; do not drive yet"


def test_a_board_that_falls_silent_ends_the_check():
    with emulated() as emulator:
        turn = emulator.world.step

        def step(duty):
            turn(duty)
            emulator.line.is_silent = any(emulator.world.speeds)

        emulator.world.step = step
        done = run("check", "--yes", "--port", emulator.line.name)
        assert "the board has fallen silent: is its cable loose?" in str(done.exception)


COVARIANCE = tuple(0.0025 if n in (0, 7, 35) else 0.0 for n in range(36))
"""That of a detection: 0.05 m, and 0.05 rad."""


class Walker:
    """A person who walks from the origin along x at 0.5 m/s; a sensor reports them at 25 Hz."""

    def __init__(self, bus, robot):
        self._robot, self._put = robot, bus.publisher(OBSERVATION).put
        self._begin_s = self._reported_s = time.monotonic()

    def walked_s(self):
        """Report the person if that is due; return the time since they started [s]."""
        now_s = time.monotonic()
        if now_s - self._reported_s >= 0.04:
            self._reported_s = now_s
            person = self._robot.pose.between(Pose2D(self.x_m, 0.0, 0.0))
            pose = PoseWithCovariance(Pose.planar(person), COVARIANCE)
            header = Header(stamp=self._robot.message.header.stamp, frame_id="base_link")
            self._put(Observation(header, (pose,)), None)
        return now_s - self._begin_s

    @property
    def x_m(self):
        return 0.5 * (time.monotonic() - self._begin_s)


def test_a_robot_behind_an_emulated_board_follows(tmp_path):
    port = tmp_path / "board"
    board = Command("hardware", "emulate", "teleop", "--link", port)
    board.read_until("until Ctrl-C")
    services = 'services=["hardware","controller","follower"]'
    stack = Stack(
        SCENARIOS / "back.toml", (services, "robot=rosmaster_x3", f"hardware.port={port}")
    )
    try:
        robot = Newest(stack.bus, ODOM)
        stack.start()
        stack.wait(lambda: robot.message is not None)
        walker = Walker(stack.bus, robot)
        stack.wait(lambda: walker.walked_s() > 5.0)
        # a robot that stands would now be 2.5 m farther away
        assert walker.x_m - robot.pose.x == pytest.approx(1.0, abs=0.1)
        code, text, _ = board.end()
        assert code == 0
        assert re.search(r"[0-9]{3} frames taken", text)
        with pytest.raises(MecazenError, match=r"hardware: .*the port has gone in mid-run"):
            stack.wait(lambda: False)
    finally:
        stack.close()
