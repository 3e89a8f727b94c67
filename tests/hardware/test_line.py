"""The pseudo-terminal at the end of an emulated line."""

import pytest
import serial
from mecazen.errors import MecazenError
from mecazen_hardware.emulator.line import Line


@pytest.fixture
def line():
    made = Line()
    yield made
    made.close()


def test_the_other_end_opens_as_a_serial_port_and_hears_bytes_at_the_speed_of_the_line(line):
    with serial.Serial(line.name, 115200, timeout=1.0) as port:
        line.send(bytes(range(23)))
        for _ in range(2):
            line.millisecond()
        assert line.waiting == 0
        assert port.read(23) == bytes(range(23))
        line.send(bytes(100))
        line.millisecond()
        assert line.waiting == 100 - 11  # 11.52 bytes in a millisecond


def test_what_the_host_sends_comes_unchanged_and_is_not_echoed(line):
    with serial.Serial(line.name, 115200, timeout=0.05) as port:
        port.write(b"\x03\x04\r\n\xff\xfc\x11\x13")
        assert line.read() == b"\x03\x04\r\n\xff\xfc\x11\x13"
        assert port.read(1) == b""
    assert line.read() == b""  # no one has it open: no error


def test_bytes_that_no_one_reads_stop_nothing(line):
    for _ in range(2000):
        line.send(bytes(11))
        line.millisecond()
    with serial.Serial(line.name, 115200, timeout=0.1) as port:
        port.reset_input_buffer()
        line.send(b"newer!!")
        line.millisecond()
        assert port.read(100) == b"newer!!"


def test_a_link_names_the_port_until_it_is_unplugged(tmp_path):
    link = tmp_path / "board"
    link.symlink_to("/dev/pts/none")  # left by an emulator that was killed
    line = Line(link)
    assert link.readlink() == type(link)(line.name)
    with pytest.raises(MecazenError, match="taken; another emulator may have it"):
        Line(link)
    line.unplug()
    assert not link.is_symlink()
    line.close()


def test_a_link_to_where_nothing_can_be_is_one_line(tmp_path):
    with pytest.raises(MecazenError, match="No such file or directory"):
        Line(tmp_path / "none" / "board")
