"""The link to a board: its port, its frames at the start, in mid-run, and at each kind of end."""

import errno
import os
import pty
import signal
import subprocess
import sys
import threading
import time
import tty
from contextlib import contextmanager
from itertools import pairwise

import pytest
import serial
from hardware.stand import MOTION, ROBOT, STOP_WITHIN_S, config, emulated, linked, until
from harness import error_of
from mecazen.config import HardwareConfig
from mecazen.errors import ConfigError
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.board import Inertial, Voltage, WheelAngles
from mecazen_hardware.keeper import DRIVE, STOP, keep
from mecazen_hardware.link import Link
from mecazen_hardware.port import HardwareError, Port

FORWARD = WheelSpeeds(10.0, 10.0, 10.0, 10.0)

DRIVING = """
import sys, time
from contextlib import closing
from hardware.stand import ROBOT
from mecazen.config import HardwareConfig
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.link import Link
with closing(Link(HardwareConfig(port=sys.argv[1]), ROBOT)) as link:
    print("driving", flush=True)
    for _ in range(1000):
        link.drive(WheelSpeeds(10.0, 10.0, 10.0, 10.0))
        time.sleep(0.02)
        {then}
"""


@contextmanager
def driving(emulator, then="pass"):
    """Yield a process that drives the wheels, once they turn."""
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVING.format(then=then), emulator.line.name],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout.readline() == "driving\n"
        until(lambda: any(emulator.firmware.goal))
        yield process
        until(lambda: not any(emulator.firmware.goal))
        assert emulator.firmware.stopped_after_s < STOP_WITHIN_S
    finally:
        process.kill()
        process.communicate()


def drive_for(duration_s, link, period_s=0.01):
    for _ in range(round(duration_s / period_s)):
        link.drive(FORWARD)
        link.read()
        time.sleep(period_s)


def test_a_board_sends_its_reports_and_takes_frames():
    with emulated() as emulator:
        with linked(emulator) as link:
            assert link.identity.name == "ROSMASTER X3, firmware 3.5"
            for _ in range(50):
                link.drive(FORWARD)
                time.sleep(0.01)
            reports = [report for report, _ in link.read()]
            assert {WheelAngles, Inertial, Voltage} <= {*map(type, reports)}
            angles = [report.angles[0] for report in reports if isinstance(report, WheelAngles)]
            assert angles[-1] > 1.0
            until(lambda: emulator.firmware.taken + emulator.firmware.lost == link.sent)
            # the emulated board loses a frame if a busy machine lets it read late
            assert emulator.firmware.lost <= link.sent // 20
        until(lambda: not any(emulator.firmware.goal))


def test_of_frames_in_quick_succession_the_newest_is_sent(monkeypatch):
    with emulated() as emulator, linked(emulator) as link:
        written, write = [], link.port.write
        monkeypatch.setattr(
            link.port,
            "write",
            lambda frame: written.append((time.monotonic(), frame)) or write(frame),
        )
        speeds = [WheelSpeeds(*[speed] * 4) for speed in (2.0, 4.0, 6.0, 8.0)]
        for speed in speeds:
            link.drive(speed)
        link.stop()
        link.drive(speeds[-1])
        until(lambda: emulator.firmware.goal == pytest.approx([8.0 * 32.5] * 4, abs=1.0))
        frames = [frame for _, frame in written]
        assert frames[-5:] == [*link.board.stop(), link.board.drive(speeds[-1])[0]]
        assert len(frames) <= 7
        gaps = [after - before for (before, _), (after, _) in pairwise(written)]
        assert min(gaps) >= link.board.SPACING_S


def test_the_motors_are_stopped_when_the_driver_is_killed():
    with emulated() as emulator, driving(emulator) as process:
        process.kill()


def test_the_motors_are_stopped_while_the_driver_is_frozen():
    with emulated() as emulator, driving(emulator) as process:
        process.send_signal(signal.SIGSTOP)


@pytest.mark.parametrize("then", ["1 / 0", "raise KeyboardInterrupt", "sys.exit(3)"])
def test_the_motors_are_stopped_when_the_driver_ends_by_an_exception(then):
    with emulated() as emulator, driving(emulator, then):
        pass


@pytest.mark.parametrize("period_s", [0.05, 0.001])  # written at once, or after a wait
def test_without_its_keeper_the_driver_stops_the_motors_and_ends(period_s):
    with emulated() as emulator:
        with linked(emulator) as link:
            link.drive(FORWARD)
            until(lambda: any(emulator.firmware.goal))
            link.keeper.kill()
            link.keeper.wait()
            with pytest.raises(HardwareError, match=r"in an emergency was killed; start again$"):
                drive_for(10.0, link, period_s)
            assert any(emulator.firmware.goal)  # the board keeps its last command
        until(lambda: not any(emulator.firmware.goal))


@pytest.fixture
def keeper():
    """The driver's end of the heartbeat, the board's end of the port, and the number of stops."""
    received, beat = os.pipe()
    board, port = os.pipe()
    stops = []
    thread = threading.Thread(
        target=lambda: stops.append(keep(port, received, 0.1, 0.001, [b"zero", b"reset"])),
        daemon=True,
    )
    thread.start()
    yield beat, board, thread, stops
    for fd in (received, board, port):
        os.close(fd)


def test_a_keeper_stops_the_motors_after_silence_and_at_the_end(keeper):
    beat, board, thread, stops = keeper
    os.write(beat, DRIVE)
    assert os.read(board, 4) + os.read(board, 5) == b"zeroreset"
    os.close(beat)
    thread.join()
    assert os.read(board, 4) + os.read(board, 5) == b"zeroreset"
    assert stops == [2]


def test_a_driver_at_rest_may_be_silent(keeper):
    beat, board, thread, stops = keeper
    os.write(beat, DRIVE)
    os.write(beat, STOP)
    thread.join(0.3)
    os.close(beat)
    thread.join()
    assert stops == [1]
    assert os.read(board, 9) == b"zeroreset"


def test_what_can_not_be_opened_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr("mecazen_hardware.port.BUSY_FOR_S", 0.1)
    (tmp_path / "file").touch()

    def error(kind=HardwareError, **settings):
        return error_of(kind, lambda: Link(HardwareConfig(**settings), ROBOT))

    assert "/dev/ttyUSB77: no such port; ports here: " in error(port="/dev/ttyUSB77")
    assert "not a serial port" in error(port=str(tmp_path / "file"))
    assert "no board 'x3': rosmaster_x3, or " in error(ConfigError, board="x3")
    assert "no board 'math:pi': " in error(ConfigError, board="math:pi")
    assert "none.py: can't be imported" in error(ConfigError, board="/none.py:MyBoard")
    with emulated() as emulator, linked(emulator):
        assert "in use by another program" in error(port=emulator.line.name)
    for number, reason in (
        (errno.EACCES, "no permission; `sudo usermod -aG "),
        (errno.EIO, "can't be opened: "),
    ):

        def refuse(*_, number=number, **__):
            raise serial.SerialException(number, "refused")

        monkeypatch.setattr(serial, "Serial", refuse)
        assert f"/dev/null: {reason}" in error(port="/dev/null")


def test_a_port_is_free_again_once_it_is_closed():
    with emulated() as emulator:
        for _ in range(2):
            Port(config(emulator).port, 115200).close()


@pytest.mark.parametrize(
    ("sent", "reason"), [(b"", "nothing answers"), (b"$GPGGA,123519", "not a rosmaster_x3")]
)
def test_a_port_without_this_board_is_named(sent, reason, monkeypatch):
    monkeypatch.setattr("mecazen_hardware.link.ANSWER_S", 0.5)
    board_end, port_end = pty.openpty()
    tty.setraw(port_end)
    talking = threading.Timer(0.2, os.write, (board_end, sent))  # opening a port empties it
    talking.start()
    try:
        with pytest.raises(HardwareError, match=reason):
            Link(HardwareConfig(port=os.ttyname(port_end)), ROBOT)
    finally:
        talking.join()
        os.close(board_end)
        os.close(port_end)


def test_a_board_without_counts_is_named(monkeypatch):
    monkeypatch.setattr("mecazen_hardware.link.ANSWER_S", 0.5)
    monkeypatch.setattr("mecazen_hardware.emulator.firmware.COUNTS_AT", -1)
    with emulated() as emulator, pytest.raises(HardwareError, match="does not send WheelAngles"):
        Link(config(emulator), ROBOT)


def test_a_board_of_another_car_is_not_driven():
    with emulated(car_type=5) as emulator:
        with pytest.raises(HardwareError, match="set to the car R2"):
            Link(config(emulator), ROBOT)
        log = emulator.firmware.log
        assert not [1 for _, function, payload in log if function == MOTION and any(payload[1:])]


def test_a_port_that_is_unplugged_in_mid_run_is_one_error():
    with emulated() as emulator:
        link = Link(config(emulator), ROBOT)
        drive_for(0.3, link)
    try:
        with pytest.raises(HardwareError, match="the port has gone in mid-run"):
            drive_for(5.0, link)
    finally:
        link.close()
    # the board keeps its last command for ever: no software can stop it now
    assert any(emulator.firmware.goal)
