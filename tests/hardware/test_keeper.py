"""The process that stops the motors if the driver can't."""

import os
import threading

import pytest
from mecazen_hardware.keeper import DRIVE, STOP, keep

FRAMES = [b"zero", b"reset"]


@pytest.fixture
def keeper():
    """The driver's end of the heartbeat, the board's end of the port, and how often it stopped."""
    heard, beat = os.pipe()
    board, port = os.pipe()
    stops = []
    thread = threading.Thread(
        target=lambda: stops.append(keep(port, heard, 0.1, 0.001, FRAMES)), daemon=True
    )
    thread.start()
    yield beat, board, thread, stops
    for one in (heard, board, port):
        os.close(one)


def test_silence_after_motion_stops_the_motors_and_so_does_the_end_of_the_driver(keeper):
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
