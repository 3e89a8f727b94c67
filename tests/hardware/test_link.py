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
from hardware.stand import ROBOT, STOP_WITHIN_S, emulated, linked, until
from harness import error_of
from mecazen.config import HardwareConfig
from mecazen.errors import ConfigError
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.keeper import DRIVE, STOP, keep
from mecazen_hardware.link import HardwareError, Link

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
def driving(emulator, then):
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
        until(lambda: emulator.firmware.driving)
        yield process
        until(lambda: not any(emulator.firmware.goal))
        assert emulator.firmware.stopped_after_s < STOP_WITHIN_S
    finally:
        process.kill()
        process.communicate()


def drive_for(duration_s, link):
    for _ in range(round(duration_s / 0.01)):
        link.drive(FORWARD)
        link.read()
        time.sleep(0.01)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP, "1 / 0"])
def test_the_motors_stop_however_the_driver_ends(end):
    is_signal = isinstance(end, signal.Signals)
    with emulated() as emulator, driving(emulator, "pass" if is_signal else end) as process:
        if is_signal:
            process.send_signal(end)


def test_newest_of_frequent_frames_is_sent(monkeypatch):
    with emulated() as emulator, linked(emulator) as link:
        assert link.identity.name == "ROSMASTER X3, firmware 3.5"
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


def test_without_its_keeper_the_driver_stops_and_ends():
    with emulated() as emulator:
        with linked(emulator) as link:
            link.drive(FORWARD)
            until(lambda: any(emulator.firmware.goal))
            link.keeper.kill()
            link.keeper.wait()
            with pytest.raises(HardwareError, match=r"in an emergency was killed; start again$"):
                drive_for(10.0, link)
            assert any(emulator.firmware.goal)  # the board keeps its last command
        until(lambda: not any(emulator.firmware.goal))


def test_keeper_stops_the_motors_after_silence():
    received, beat = os.pipe()
    board, port = os.pipe()
    stops = []
    frames = [b"zero", b"reset"]
    thread = threading.Thread(
        target=lambda: stops.append(keep(port, received, 0.1, 0.001, frames)), daemon=True
    )
    thread.start()
    os.write(beat, DRIVE)
    assert os.read(board, 4) + os.read(board, 5) == b"zeroreset"
    os.write(beat, DRIVE)
    os.write(beat, STOP)
    thread.join(0.3)  # a driver at rest may be silent
    os.close(beat)
    thread.join()
    assert os.read(board, 4) + os.read(board, 5) == b"zeroreset"
    assert stops == [2]
    for fd in (received, board, port):
        os.close(fd)


def error(kind=HardwareError, **settings):
    return error_of(kind, lambda: Link(HardwareConfig(**settings), ROBOT))


def test_what_can_not_be_opened_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr("mecazen_hardware.link.BUSY_FOR_S", 0.1)
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


@pytest.mark.parametrize(
    ("sent", "reason"), [(b"", "nothing answers"), (b"$GPGGA,123519", "not a rosmaster_x3")]
)
def test_a_port_without_this_board_is_named(sent, reason, monkeypatch):
    monkeypatch.setattr("mecazen_hardware.link.ANSWER_S", 0.5)
    board_end, port_end = pty.openpty()
    tty.setraw(port_end)
    talking = threading.Timer(0.2, os.write, (board_end, sent))  # opening a port empties it
    talking.start()
    assert reason in error(port=os.ttyname(port_end))
    talking.join()
    os.close(board_end)
    os.close(port_end)


def test_a_board_of_another_car_is_named(monkeypatch):
    monkeypatch.setattr("mecazen_hardware.link.ANSWER_S", 0.5)
    with emulated(car_type=5) as emulator:
        assert "set to the car R2" in error(port=emulator.line.name)
        assert not emulator.firmware.driving


def test_unplugged_port_is_one_error():
    with emulated() as emulator:
        link = Link(HardwareConfig(port=emulator.line.name), ROBOT)
        drive_for(0.3, link)
    try:
        with pytest.raises(HardwareError, match="the port has gone in mid-run"):
            drive_for(5.0, link)
    finally:
        link.close()
    # the board keeps its last command for ever: no software can stop it now
    assert any(emulator.firmware.goal)
