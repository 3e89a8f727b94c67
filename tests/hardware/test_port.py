"""The port of a board: what it carries, and the errors of opening it."""

import errno

import pytest
import serial
from hardware.stand import config, emulated
from mecazen_hardware.emulator.line import Line
from mecazen_hardware.errors import HardwareError
from mecazen_hardware.port import Port


def test_bytes_go_both_ways_and_no_call_waits():
    line = Line()
    port = Port(line.name, 115200)
    assert port.read(0.0) == b""
    line.send(b"report")
    line.millisecond()
    assert port.read(1.0) == b"report"
    assert port.write(b"frame")
    assert line.read() == b"frame"
    line.unplug()
    with pytest.raises(HardwareError, match="the port has gone in mid-run"):
        port.read(1.0)
    port.close()


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EACCES, "no permission; `sudo usermod -aG "),
        (errno.EBUSY, "in use by another program"),
        (errno.EIO, "can't be opened: "),
    ],
)
def test_each_refusal_of_the_system_is_one_line_with_a_remedy(monkeypatch, number, words):
    def refuse(*_, **__):
        raise serial.SerialException(number, "refused")

    monkeypatch.setattr("mecazen_hardware.port.BUSY_FOR_S", 0.0)
    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(HardwareError, match=rf"^/dev/null: {words}"):
        Port("/dev/null", 115200)


def test_a_port_is_free_again_once_it_is_closed():
    with emulated() as emulator:
        for _ in range(2):
            Port(config(emulator).port, 115200).close()
