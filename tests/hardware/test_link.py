"""The link to a board: its frames at the start, in mid-run, and at each kind of end."""

import os
import pty
import signal
import subprocess
import sys
import threading
import time
import tty
from itertools import pairwise

import pytest
from hardware.stand import MOTION, ROBOT, config, emulated, until
from mecazen.config import HardwareConfig
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.board import Inertial, Voltage, WheelAngles
from mecazen_hardware.boards import open_link
from mecazen_hardware.emulator.faults import Requested
from mecazen_hardware.errors import HardwareError

FORWARD = WheelSpeeds(10.0, 10.0, 10.0, 10.0)
MOST_S = 0.5
"""Time after the last command within which a stop frame has to come [s]."""

DRIVING = """
import sys, time
from hardware.stand import ROBOT
from mecazen.config import HardwareConfig
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.boards import open_link
link = open_link(HardwareConfig(port=sys.argv[1]), ROBOT)
try:
    print("driving", flush=True)
    for _ in range(1000):
        link.drive(WheelSpeeds(10.0, 10.0, 10.0, 10.0))
        time.sleep(0.02)
        {then}
finally:
    link.close()
"""


def start_driving(emulator, then="pass"):
    """Start a process that drives the wheels; return it when they turn."""
    path = os.pathsep.join([*sys.path])
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVING.format(then=then), emulator.line.name],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "driving\n"
    until(lambda: any(emulator.firmware.goal))
    return process


def drive_for(duration_s, link, period_s=0.01):
    for _ in range(round(duration_s / period_s)):
        link.drive(FORWARD)
        link.read()
        time.sleep(period_s)


def test_a_board_that_answers_sends_all_kinds_of_reports_and_takes_the_frames():
    with emulated() as emulator:
        link = open_link(config(emulator), ROBOT)
        try:
            assert link.identity.name == "ROSMASTER X3, firmware 3.5"
            for _ in range(50):
                link.drive(FORWARD)
                time.sleep(0.01)
            reports = [report for report, _ in link.read()]
            assert {WheelAngles, Inertial, Voltage} <= {*map(type, reports)}
            angles = [one.turned[0] for one in reports if isinstance(one, WheelAngles)]
            assert angles[-1] > 1.0
            until(lambda: emulator.firmware.taken + emulator.firmware.lost == link.sent)
            # the emulated board loses a frame if a busy machine lets it read late
            assert emulator.firmware.lost <= link.sent // 20
        finally:
            link.close()
        until(lambda: not any(emulator.firmware.goal))


def test_of_frames_that_follow_too_soon_the_newest_is_sent_once_the_board_can_take_it():
    with emulated() as emulator:
        link = open_link(config(emulator), ROBOT)
        try:
            sent = link.sent
            for speed in (2.0, 4.0, 6.0, 8.0):
                link.drive(WheelSpeeds(*[speed] * 4))
            until(lambda: link.sent == sent + 2)
            until(lambda: emulator.firmware.goal == pytest.approx([8.0 * 32.5] * 4, abs=1.0))
        finally:
            link.close()


def test_a_request_for_reports_keeps_the_spacing_and_the_waiting_frame(monkeypatch):
    with emulated() as emulator:
        link = open_link(config(emulator), ROBOT)
        written, write = [], link.port.write
        monkeypatch.setattr(link.board, "poll", lambda: b"reports")
        monkeypatch.setattr(
            link.port,
            "write",
            lambda frame: written.append((time.monotonic(), frame)) or write(frame),
        )
        try:
            speeds = [WheelSpeeds(*[speed] * 4) for speed in (2.0, 8.0)]
            for speed in speeds:
                link.drive(speed)
            link.poll()
            until(lambda: len(written) == 3)
            slow, fast = (link.board.drive(speed)[0] for speed in speeds)
            assert [frame for _, frame in written] == [slow, fast, b"reports"]
            times = [at_s for at_s, _ in written]
            gaps = [after - before for before, after in pairwise(times)]
            assert min(gaps) >= link.board.SPACING_S
        finally:
            link.close()


def test_the_motors_are_stopped_when_the_driver_is_killed():
    with emulated() as emulator:
        process = start_driving(emulator)
        process.kill()
        process.communicate()
        until(lambda: not any(emulator.firmware.goal))
        assert emulator.firmware.stopped_after_s < MOST_S


def test_the_motors_are_stopped_while_the_driver_is_frozen():
    with emulated() as emulator:
        process = start_driving(emulator)
        process.send_signal(signal.SIGSTOP)
        until(lambda: not any(emulator.firmware.goal))
        assert emulator.firmware.stopped_after_s < MOST_S
        process.kill()
        process.communicate()


@pytest.mark.parametrize("then", ["1 / 0", "raise KeyboardInterrupt", "sys.exit(3)"])
def test_the_motors_are_stopped_when_the_driver_ends_by_an_exception(then):
    with emulated() as emulator:
        process = start_driving(emulator, then)
        process.communicate(timeout=20)
        until(lambda: not any(emulator.firmware.goal))
        assert emulator.firmware.stopped_after_s < MOST_S


@pytest.mark.parametrize("period_s", [0.05, 0.001])  # written at once, or by a thread
def test_without_the_process_that_outlives_it_the_driver_stops_the_motors_and_ends(period_s):
    with emulated() as emulator:
        link = open_link(config(emulator), ROBOT)
        try:
            link.drive(FORWARD)
            until(lambda: any(emulator.firmware.goal))
            link._keeper.kill()
            link._keeper.wait()
            with pytest.raises(HardwareError, match=r"in an emergency was killed; start again$"):
                drive_for(10.0, link, period_s)
            assert any(emulator.firmware.goal)  # the board keeps its last command
        finally:
            link.close()
        until(lambda: not any(emulator.firmware.goal))


def test_a_port_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(HardwareError, match=r"^/dev/ttyUSB77: no such port; ports here: "):
        open_link(HardwareConfig(port="/dev/ttyUSB77"), ROBOT)


def test_a_file_is_no_port(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(HardwareError, match=r"not a serial port$"):
        open_link(HardwareConfig(port=str(tmp_path / "file")), ROBOT)


def test_a_port_has_one_driver(monkeypatch):
    monkeypatch.setattr("mecazen_hardware.port.BUSY_FOR_S", 0.1)
    with emulated() as emulator:
        link = open_link(config(emulator), ROBOT)
        try:
            with pytest.raises(HardwareError, match="in use by another program"):
                open_link(config(emulator), ROBOT)
        finally:
            link.close()


def test_a_tcp_port_where_no_robot_listens_is_named():
    with pytest.raises(HardwareError, match="no robot answers there"):
        open_link(HardwareConfig(port="socket://127.0.0.1:1"), ROBOT)


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
        port = os.ttyname(port_end)
        with pytest.raises(HardwareError, match=reason):
            open_link(HardwareConfig(port=port), ROBOT)
    finally:
        talking.join()
        os.close(board_end)
        os.close(port_end)


def test_a_board_of_another_car_is_not_driven():
    with emulated(car_type=5) as emulator:
        with pytest.raises(HardwareError, match="set to the car R2"):
            open_link(config(emulator), ROBOT)
        heard = emulator.firmware.heard
        assert not [rest for _, function, rest in heard if function == MOTION and any(rest[1:])]


def test_a_port_that_is_unplugged_in_mid_run_is_one_error():
    with emulated(Requested({}, {"unplug": 0.3})) as emulator:
        link = open_link(config(emulator), ROBOT)
        try:
            with pytest.raises(HardwareError, match="the port has gone in mid-run"):
                drive_for(5.0, link)
        finally:
            link.close()
        # the board keeps its last command for ever: no software can stop it now
        assert any(emulator.firmware.goal)
