"""Damaged frames: few are taken, none stops the receiver."""

from hardware.stand import Hearing
from mecazen_hardware.emulator.firmware import Instruments
from mecazen_hardware.fuzzing import LOST_AT_MOST, fuzz

FRAMES = 20_000
"""`mecazen hardware fuzz` sends a million."""


def test_the_receiver_finds_the_next_whole_frame_after_any_damage():
    found = fuzz(FRAMES, seed=3)
    assert found.largest_loss <= LOST_AT_MOST
    # bytes that are damaged, or that a cut brings together, have a valid sum once in 256
    assert found.received_by_chance <= found.damaged / 256
    # a beginning in damaged bytes may swallow a whole frame if the sum is valid by chance
    assert found.whole_received >= found.whole - found.received_by_chance * 2


def test_no_bytes_stop_the_firmware():
    import random

    draw, board = random.Random(5), Hearing()
    for _ in range(FRAMES):
        for byte in (b"\xff\xfc" if draw.random() < 0.5 else b"") + draw.randbytes(9):
            board.receive(byte)
        board.millisecond(lambda: Instruments(volts=12.0))
    assert not board.is_latched
