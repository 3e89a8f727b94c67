"""The emulator in real time: gaps between frames, faults, and samples for the robot's bus."""

import struct
from types import SimpleNamespace

import serial
from hardware.stand import NO_FAULTS, Hearing, Stand, emulated, until
from mecazen.config import BusConfig
from mecazen.messages import Header, Observation, Time, Twist
from mecazen_hardware.emulator.emulator import Emulator
from mecazen_hardware.emulator.faults import Requested
from mecazen_hardware.emulator.line import Line
from mecazen_hardware.emulator.relay import Relay

MOTION = struct.pack("<4B", 0xFF, 0xFC, 10, 0x12) + struct.pack("<B3h", 1, 300, 0, 0)
FRAME = MOTION + bytes((sum(MOTION[2:]) % 256,))


def test_of_two_frames_in_one_write_the_second_destroys_the_first(monkeypatch):
    # between both looks no time passes, so the frames can't have had a gap
    standing = SimpleNamespace(monotonic=lambda: 1.0)
    monkeypatch.setattr("mecazen_hardware.emulator.emulator.time", standing)
    line = Line()
    emulator = Emulator(line, Stand(), Hearing(), NO_FAULTS)
    with serial.Serial(line.name, 115200) as port:
        emulator._look()
        port.write(FRAME * 2)
        emulator._look()
        for _ in range(100):
            emulator._millisecond()
    line.close()
    assert (emulator.firmware.taken, emulator.firmware.lost) == (1, 1)


def test_the_world_begins_with_the_first_frame_that_drives():
    with emulated() as emulator, serial.Serial(emulator.line.name, 115200) as port:
        port.write(bytes.fromhex("FFFC04220127"))
        until(lambda: emulator.firmware.taken == 1)
        assert not emulator.world.has_begun
        port.write(FRAME)
        until(lambda: emulator.world.has_begun)


def test_bytes_are_late_by_the_delay_that_is_asked_for():
    late = Requested({}, {}, delay_s=0.3)
    with emulated(late) as emulator, serial.Serial(emulator.line.name, 115200) as port:
        asked_ms = emulator._ms
        port.write(FRAME)
        until(lambda: emulator.firmware.taken == 1)
        assert emulator._ms - asked_ms >= 300


def test_headers_have_the_time_of_the_driver_and_other_messages_stay():
    relay = Relay(BusConfig(connect=("tcp/127.0.0.1:1",)))
    try:
        relay._clock_ns = 100_000_000_000
        seen = Observation(header=Header(stamp=Time(sec=4)))
        assert relay._stamped(seen, 5_000_000_000).header.stamp == Time(sec=99)
        assert relay._stamped(Twist(), 0) == Twist()
    finally:
        relay.close()
