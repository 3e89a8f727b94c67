"""The emulated board, by the rules of the vendor's source: firmware, motors, line and physics."""

import math
import struct

import pytest
import serial
from hardware.stand import frame
from harness import SCENARIOS
from mecazen.errors import MecazenError
from mecazen_hardware.emulator.firmware import CYCLE_MS, Firmware, Instruments
from mecazen_hardware.emulator.line import SerialLine
from mecazen_hardware.emulator.world import BREAK_AWAY_V, EmulatedWorld, load, motor_torque


def motion(x, y=0, yaw=0):
    return frame(0x12, struct.pack("<B3h", 1, x, y, yaw))


def take(board, *frames):
    """Let a frame arrive in each millisecond."""
    for sent in frames:
        for byte in sent:
            board.receive(byte)
        run(board, 1)


def run(board, ms, measured=Instruments(volts=12.0)):  # noqa: B008  # immutable
    """Return what the board sends in some milliseconds."""
    return [sent for _ in range(ms) if (sent := board.millisecond(measured))]


def test_reports_have_the_vendors_period_and_scales():
    turn, half = (0.5, -0.25, 0.125), (0.1, -0.2, math.pi)
    measured = Instruments((math.tau, 0.0, -math.pi, 0.0), 11.97, turn, (0.0, 0.0, 9.81), half)
    sent = run(Firmware(), 3 * CYCLE_MS, measured)
    assert [report[3] for report in sent] == [0x0A, 0x0E, 0x0C, 0x0D] * 3
    assert all(sum(report[2:-1]) % 256 == report[-1] for report in sent)
    newest = {report[3]: report[4:-1] for report in sent}
    assert newest[0x0A][-1] == 119  # tenths of a volt, cut
    assert struct.unpack("<9h", newest[0x0E])[:6] == (500, -250, 125, 0, 0, 9810)
    assert struct.unpack("<3h", newest[0x0C]) == (1000, -2000, 31415)
    assert struct.unpack("<4i", newest[0x0D]) == (1320, 0, -660, 0)


def test_twist_becomes_limited_rim_speeds():
    board = Firmware()
    take(board, motion(500, 200, 1000))
    turn = 164.555
    assert board.goal == pytest.approx([300 - turn, 700 - turn, 700 + turn, 300 + turn])
    take(board, motion(900, 900, 0))
    run(board, 60_000)
    assert board.goal == [0.0, 1000.0, 1000.0, 0.0]  # the direction is lost; kept for ever


@pytest.mark.parametrize(
    ("volts", "latches"), [(9.5, True), (13.1, True), (8.0, False), (12.0, False)]
)
def test_bad_supply_switches_the_motors_off(volts, latches):
    board = Firmware()
    take(board, motion(500))
    run(board, 1900, Instruments(volts=volts))
    assert not board.is_latched
    run(board, 300, Instruments(volts=volts))
    assert board.is_latched == latches
    if latches:
        assert run(board, 200) == []  # reports have ended
        take(board, motion(500))
        assert board.goal == [0.0] * 4
        take(board, frame(0x0F, b"\x5f"), motion(500))
        assert board.goal == [500.0] * 4


def test_motor_has_the_torques_of_its_data_sheet():
    assert motor_torque(BREAK_AWAY_V - 0.1, 0.0)[0] == 0.0
    assert motor_torque(BREAK_AWAY_V + 0.1, 0.0)[0] > 0.0 > motor_torque(-6.0, 0.0)[0]
    stall, current = motor_torque(12.0, 0.0)
    assert stall + 3.3 * 0.157 / 4.5 == pytest.approx(0.42, abs=0.01)  # without friction
    assert current == pytest.approx(2.7, abs=0.1)  # from 2.4 to 3 A
    assert motor_torque(12.0, 30.0)[0] < 0.0 < motor_torque(12.0, 20.0)[0]
    # without supply it coasts, and a short circuit brakes harder
    assert motor_torque(0.0, 20.0)[0] < motor_torque(None, 20.0)[0] < 0.0


def test_duty_drives_the_robot_and_costs_voltage():
    world = EmulatedWorld(load(SCENARIOS / "back.toml", ("start.x_m=-3.0",)))
    for _ in range(100):
        world.step([0.7, 0.7, 0.7, 0.7])
    measured = world.measured
    assert min(measured.angles) > 2.0
    assert max(measured.angles) - min(measured.angles) < 0.1
    assert 11.0 < measured.volts < 12.0
    assert measured.accel[2] == pytest.approx(9.81, abs=1.0)
    for _ in range(100):
        world.step([0.7, 0.7, -0.7, -0.7])  # m1 and m2 are on the left: it turns to the right
    assert world.measured.attitude[2] < -0.1


def test_a_line_carries_bytes_unchanged_and_without_echo():
    line = SerialLine()
    with serial.Serial(line.name, 115200, timeout=0.05) as port:
        port.write(b"\x03\x04\r\n\xff\xfc\x11\x13")
        assert line.read() == b"\x03\x04\r\n\xff\xfc\x11\x13"
        assert port.read(1) == b""
        line.millisecond(bytes(range(23)))
        assert port.read(23) == bytes(range(11))  # 11.52 bytes in a millisecond
        line.millisecond(b"")
        line.millisecond(b"")
        assert port.read(23) == bytes(range(11, 23))
    assert line.read() == b""  # no one has it open: no error
    for _ in range(2000):  # bytes that no one reads stop nothing
        line.millisecond(bytes(11))
    with serial.Serial(line.name, 115200, timeout=0.1) as port:
        port.reset_input_buffer()
        line.millisecond(b"newer!!")
        assert port.read(100) == b"newer!!"
    line.close()


def test_a_link_names_the_port_until_it_closes(tmp_path):
    link = tmp_path / "board"
    link.symlink_to("/dev/pts/none")  # left by an emulator that was killed
    line = SerialLine(link)
    assert link.readlink() == type(link)(line.name)
    with pytest.raises(MecazenError, match="taken: stop the other emulator"):
        SerialLine(link)
    line.close()
    assert not link.is_symlink()
    with pytest.raises(MecazenError, match="No such file or directory"):
        SerialLine(tmp_path / "none" / "board")
