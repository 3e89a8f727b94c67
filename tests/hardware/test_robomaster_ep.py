"""The text protocol of the RoboMaster EP, by itself and against a robot on TCP."""

import math
import socket
import threading
import time
from contextlib import suppress

import pytest
from hardware.stand import until
from harness import ROBOTS
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import HardwareConfig
from mecazen.loading import load_table
from mecazen.robot import Robot
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.board import Identity, MeasuredSpeeds
from mecazen_hardware.boards import open_link
from mecazen_hardware.robomaster_ep import RobomasterEp

ROBOT = load_table(ROBOTS / "robomaster_ep.toml", Robot)
RPM = math.pi / 30.0


@pytest.fixture
def board():
    return RobomasterEp(HardwareConfig(board="robomaster_ep"), ROBOT)


def test_each_wheel_has_its_own_speed_in_the_order_of_the_robot(board):
    sent, made = board.drive(WheelSpeeds(10 * RPM, 20 * RPM, 30 * RPM, 40 * RPM))
    assert sent == b"chassis wheel w1 20 w2 10 w3 40 w4 30;"
    assert list(made) == pytest.approx([10 * RPM, 20 * RPM, 30 * RPM, 40 * RPM])


@given(st.tuples(*[st.floats(-1e6, 1e6)] * 4))
def test_all_wheels_are_slowed_down_alike_whatever_is_asked(speeds):
    board = RobomasterEp(HardwareConfig(), ROBOT)
    _, made = board.drive(WheelSpeeds(*speeds))
    most = max(map(abs, speeds))
    assert max(map(abs, made)) <= ROBOT.wheels.max_speed_rad_s + RPM
    share = min(1.0, ROBOT.wheels.max_speed_rad_s / most) if most else 1.0
    assert list(made) == pytest.approx([speed * share for speed in speeds], abs=0.51 * RPM)


def test_answers_are_read_however_they_are_cut(board):
    stream = b"ok;version 01.01.0305;error;0.1 0.2 30 20 10 40 30;\xff\xfe;nonsense;1 2 3;"
    found = [report for byte in stream for report in board.feed(bytes((byte,)))]
    assert found[0] == Identity("RoboMaster EP, firmware 01.01.0305")
    assert list(found[1].speeds) == pytest.approx([10 * RPM, 20 * RPM, 30 * RPM, 40 * RPM])
    assert len(found) == 2
    assert board.frames == 4
    assert board.refused == 3


@given(st.binary(max_size=400))
def test_random_bytes_are_no_error(data):
    assert RobomasterEp(HardwareConfig(), ROBOT).feed(data) is not None


def test_text_without_an_end_is_dropped(board):
    board.feed(b"x" * 1000)
    (identity,) = board.feed(b"y;version 01.01.0305;")
    assert identity.name == "RoboMaster EP, firmware 01.01.0305"


class Robot40923(threading.Thread):
    """A robot that answers one command after the other, and does what each says."""

    def __init__(self):
        super().__init__(daemon=True)
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]
        self.rpm = [0, 0, 0, 0]
        self.heard = []
        self.start()

    def run(self):
        link, _ = self.server.accept()
        rest = b""
        while data := link.recv(4096):
            *commands, rest = (rest + data).split(b";")
            for command in commands:
                self.heard.append(command)
                with suppress(OSError):  # the driver may have gone by now
                    link.sendall(self.answer(command.decode().split()) + b";")
        link.close()
        self.server.close()

    def answer(self, words):
        if words[0] == "version":
            return b"version 01.01.0305"
        if words[:2] == ["chassis", "wheel"]:
            self.rpm = [int(word) for word in words[3::2]]
        if words == ["chassis", "speed", "?"]:
            return " ".join(map(str, [0, 0, 0, *self.rpm])).encode()
        return b"ok"


def test_a_robot_on_tcp_is_driven_and_stopped():
    robot = Robot40923()
    config = HardwareConfig(board="robomaster_ep", port=f"socket://127.0.0.1:{robot.port}")
    link = open_link(config, ROBOT)
    try:
        assert robot.heard[0] == b"command"
        link.drive(WheelSpeeds(10 * RPM, 20 * RPM, 30 * RPM, 40 * RPM))
        until(lambda: robot.rpm == [20, 10, 40, 30])
        time.sleep(link.board.SPACING_S)
        link.poll()
        until(lambda: any(link.newest(MeasuredSpeeds).speeds))
        assert link.newest(MeasuredSpeeds).speeds.rear_right == pytest.approx(40 * RPM)
    finally:
        link.close()
    until(lambda: robot.rpm == [0, 0, 0, 0])
