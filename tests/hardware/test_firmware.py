"""The emulated firmware: what the vendor's source says, millisecond by millisecond."""

import math
import struct

import pytest
from mecazen_hardware.emulator.firmware import CYCLE_MS, Firmware, Instruments

VOLTS = 12.0


def to_board(function, payload=b""):
    body = bytes((len(payload) + 3, function)) + payload
    return b"\xff\xfc" + body + bytes((sum(body) % 256,))


def motion(x, y=0, yaw=0):
    return to_board(0x12, struct.pack("<B3h", 1, x, y, yaw))


def take(board, *frames):
    """Let a frame arrive in each millisecond."""
    for frame in frames:
        for byte in frame:
            board.receive(byte)
        run(board, 1)


def run(board, ms, seen=Instruments(volts=VOLTS)):  # noqa: B008  # immutable
    """Return what the board sends in some milliseconds."""
    return [sent for _ in range(ms) if (sent := board.millisecond(lambda: seen))]


def test_reports_start_after_40_ms_and_repeat_every_41():
    sent = run(Firmware(), 40 + 3 * CYCLE_MS)
    assert [one[3] for one in sent[:8]] == [0x0A, 0x0E, 0x0C, 0x0D] * 2
    assert len(sent) == 12
    assert all(sum(one[2:-1]) % 256 == one[-1] for one in sent)


def test_what_the_board_senses_has_the_scales_of_the_vendors_library():
    turn, half = (0.5, -0.25, 0.125), (0.1, -0.2, math.pi)
    seen = Instruments((math.tau, 0.0, -math.pi, 0.0), 11.97, turn, (0.0, 0.0, 9.81), half)
    sent = {one[3]: one[4:-1] for one in run(Firmware(), 200, seen)}
    assert sent[0x0A][-1] == 119  # tenths of a volt, cut
    assert struct.unpack("<9h", sent[0x0E])[:6] == (500, -250, 125, 0, 0, 9810)
    assert struct.unpack("<3h", sent[0x0C]) == (1000, -2000, 31415)
    assert struct.unpack("<4i", sent[0x0D]) == (1320, 0, -660, 0)


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ((0x51, 0), "fffb055103055e"),
        ((0x15, 0), "fffb051501001b"),
        ((0x13, 1), "fffb0a130120033c00f40172"),
        ((0x14, 5), ""),
        ((0x13, 5), "fffb0a140590010000640018"),
    ],
)
def test_requests_are_answered_in_the_next_millisecond(request_, answer):
    board = Firmware(version=(3, 5))
    for byte in to_board(0x50, bytes(request_)):
        board.receive(byte)
    assert b"".join(run(board, 2)).hex() == answer


def test_reports_can_be_switched_off_and_on():
    board = Firmware()
    take(board, to_board(0x01, b"\x00\x00"))
    assert run(board, 200) == []
    take(board, to_board(0x01, b"\x01\x00"))
    assert len(run(board, 2 * CYCLE_MS)) == 8


def test_a_twist_becomes_speeds_of_m1_to_m4_each_cut_by_itself():
    board = Firmware()
    take(board, motion(500, 200, 1000))
    turn = 164.555
    assert board.goal == pytest.approx([300 - turn, 700 - turn, 700 + turn, 300 + turn])
    take(board, motion(900, 900, 0))
    assert board.goal == [0.0, 1000.0, 1000.0, 0.0]  # the direction is lost


def test_a_car_without_mecanum_wheels_does_not_strafe():
    board = Firmware(car_type=5)
    take(board, motion(500, 300, 0))
    assert board.goal == [500.0] * 4


def test_the_last_command_is_kept_for_ever():
    board = Firmware()
    take(board, motion(500))
    run(board, 60_000)
    assert board.goal == [500.0] * 4


def test_zero_motion_and_a_reset_brake():
    for stop in (motion(0), to_board(0x0F, b"\x5f")):
        board = Firmware()
        take(board, motion(500))
        run(board, 20)
        assert min(board.duty) > 0.44  # the fixed offset, from the first cycle of the loop on
        take(board, stop)
        assert board.duty == [0.0] * 4


def test_an_open_loop_duty_has_the_offset_and_holds_only_until_a_motion_starts_the_loop():
    board = Firmware()
    take(board, to_board(0x10, struct.pack("<4b", 10, -10, 0, 100)))
    assert board.duty == pytest.approx([0.5, -0.5, None, 1.0], nan_ok=True)
    take(board, motion(100), to_board(0x10, struct.pack("<4b", 100, 100, 100, 100)))
    run(board, 20)
    assert max(board.duty) < 1.0


def test_the_loop_reaches_a_speed_with_wheels_that_turn_as_driven():
    board, angle, speed = Firmware(), 0.0, 0.0
    take(board, motion(500))
    for _ in range(3000):
        board.millisecond(lambda angle=angle: Instruments((angle,) * 4, VOLTS))
        speed += (max(board.duty[0] * VOLTS - 3.3, 0.0) / 0.34 - speed) * 0.001 / 0.07
        angle += speed * 0.001
    # one count in 10 ms is 15.5 mm/s, which the loop can't see below
    assert speed * 32.5 == pytest.approx(500, abs=16)


@pytest.mark.parametrize("frames", [(motion(500), motion(300))])
def test_of_two_frames_without_a_gap_one_is_lost(frames):
    board = Firmware()
    for byte in frames[0] + frames[1]:
        board.receive(byte)
    run(board, 3)
    assert board.taken == 1
    assert board.lost == 1


def test_a_repeated_first_byte_and_a_wrong_sum_lose_a_frame():
    board = Firmware()
    take(board, b"\xff" + motion(500))
    assert board.taken == 0
    take(board, motion(500)[:-1] + b"\x00")
    assert (board.taken, board.goal) == (0, [0.0] * 4)
    take(board, motion(500))
    assert board.taken == 1


def test_a_frame_of_20_bytes_or_more_is_refused():
    board = Firmware()
    take(board, to_board(0x23, bytes(15)))
    assert board.taken == 0
    take(board, to_board(0x23, bytes(14)))
    assert board.taken == 1


@pytest.mark.parametrize(
    ("volts", "latches"), [(9.5, True), (13.1, True), (8.0, False), (12.0, False)]
)
def test_a_bad_supply_for_2_s_latches_the_motors_off_until_a_reset(volts, latches):
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
        take(board, to_board(0x0F, b"\x5f"), motion(500))
        assert board.goal == [500.0] * 4


def test_gains_can_be_changed_and_the_type_of_car_is_saved_only_with_its_word():
    board = Firmware()
    take(board, to_board(0x13, struct.pack("<3HB", 1000, 100, 0, 0)), to_board(0x15, b"\x02\x00"))
    assert board.car_type == 1
    take(board, to_board(0x15, b"\x02\x5f"))
    assert board.car_type == 2


def test_lights_servos_and_unknown_commands_change_nothing():
    board = Firmware()
    take(board, to_board(0x22, b"\x01"), to_board(0x02, b"\x0a\x00"), to_board(0x99, b"\x01"))
    assert (board.taken, board.drives) == (3, False)


def test_the_steering_command_drives_one_way():
    board = Firmware()
    take(board, to_board(0x11, struct.pack("<BBh", 1, 3, 30)))
    assert board.goal == [-300.0, 300.0, 300.0, -300.0]
    take(board, to_board(0x11, struct.pack("<BBh", 1, 7, 0)))
    assert board.goal == [0.0] * 4
