"""From bytes to wheels and back: the protocol of the X3, and the estimate between its reports."""

import math
import random
import struct

import pytest
from hardware.stand import ROBOT, to_host
from hypothesis import assume, given
from hypothesis import strategies as st
from mecazen.config import HardwareConfig
from mecazen.wheels import MecanumKinematics, WheelSpeeds
from mecazen_hardware.board import Inertial, Voltage, WheelAngles
from mecazen_hardware.rosmaster_x3 import RosmasterX3, frame
from mecazen_hardware.wheels import WheelEstimator

KINEMATICS = MecanumKinematics.from_robot(ROBOT)


@pytest.fixture
def board():
    return RosmasterX3(HardwareConfig(), ROBOT)


def counts(*motors):
    return to_host(0x0D, struct.pack("<4i", *motors))


def twist_of(sent):
    return [number / 1000.0 for number in struct.unpack("<3h", sent[5:11])]


def test_frames_are_those_of_the_vendors_library(board):
    vendor = bytes.fromhex("FFFC0A1201F40106FFE80302")  # vx 0.5, vy -0.25, wz 1.0
    assert frame(0x12, bytes((1, 0xF4, 0x01, 0x06, 0xFF, 0xE8, 0x03))) == vendor
    assert board.stop()[1] == bytes.fromhex("FFFC040F5F72")
    assert board.hello()[0] == bytes.fromhex("FFFC050101 0007")


def test_wheel_speeds_become_their_twist(board):
    speeds = KINEMATICS.inverse(KINEMATICS.forward(WheelSpeeds(3.0, 9.0, 5.0, 7.0)))
    sent, made = board.drive(speeds)
    # the frame has whole mm/s, up to half of which each number may be off, at 32.5 mm of radius
    assert list(made) == pytest.approx(list(speeds), abs=3 * 0.0005 / 0.0325)
    # the board's lever is 0.04 % longer than that of the robot file
    assert twist_of(sent) == pytest.approx(list(KINEMATICS.forward(speeds)), abs=6e-4, rel=1e-3)
    # speeds that no twist makes are left out: front against rear
    sent, made = board.drive(WheelSpeeds(5.0, 5.0, -5.0, -5.0))
    assert (twist_of(sent), made) == ([0.0, 0.0, 0.0], WheelSpeeds())
    with pytest.raises(ValueError, match="must be finite"):
        board.drive(WheelSpeeds(1.0, math.nan, 1.0, 1.0))


@given(st.tuples(*[st.floats(-1e6, 1e6)] * 4))
def test_limited_speeds_keep_the_direction(speeds):
    sent, made = RosmasterX3(HardwareConfig(), ROBOT).drive(WheelSpeeds(*speeds))
    x, y, yaw = twist_of(sent)
    assert abs(x) + abs(y) + 0.164555 * abs(yaw) < 1.0  # where the firmware cuts
    assert max(abs(yaw) / 5.0, abs(x), abs(y)) <= 1.0
    wanted = KINEMATICS.forward(WheelSpeeds(*speeds))
    cross = x * wanted.y - y * wanted.x
    assert abs(cross) <= 1.5e-3 * math.hypot(wanted.x, wanted.y)  # rounding to mm/s
    assert max(map(abs, made)) <= ROBOT.wheels.max_speed_rad_s


def test_reports_are_in_si_units_and_mecazens_order(board):
    (report,) = board.feed(counts(1320, 0, -1320, 660))  # front left, rear left, front right, …
    assert isinstance(report, WheelAngles)
    assert report.angles == pytest.approx((math.tau, -math.tau, 0.0, math.pi))
    assert board.feed(to_host(0x0A, bytes((0, 0, 0, 0, 0, 0, 118)))) == [Voltage(11.8)]
    numbers = (100, -200, 300, 0, 0, 9810, 0, 0, 0)
    payload = struct.pack("<9h", *numbers)
    assert board.feed(to_host(0x0E, payload)) == [Inertial((0.1, -0.2, 0.3), (0.0, 0.0, 9.81))]
    (report,) = board.feed(to_host(0x0B, payload))  # another chip, of which y and z are turned
    assert report.angular == pytest.approx((100 / 3754.9, 200 / 3754.9, -300 / 3754.9))
    assert report.force == pytest.approx((0.0, 0.0, 9810 / 1671.84))


def test_other_gears_have_other_counts():
    board = RosmasterX3(HardwareConfig(counts_per_turn=1350), ROBOT)
    (report,) = board.feed(counts(1350, 0, 0, 0))
    assert report.angles[0] == pytest.approx(math.tau)
    # the firmware believes in 1320 counts, so it must be asked for more
    asked = twist_of(board.drive(WheelSpeeds(10.0, 10.0, 10.0, 10.0))[0])[0]
    assert asked == pytest.approx(0.325 * 1350 / 1320, abs=5e-4)


@given(st.integers(0, 20), st.binary(min_size=1, max_size=4), st.booleans())
def test_each_frame_after_a_damaged_one_is_read(place, garbage, is_cut):
    board, first = RosmasterX3(HardwareConfig(), ROBOT), counts(70000, -5, 123456, 9)
    damaged = first[:place] + garbage + (b"" if is_cut else first[place + len(garbage) :])
    stream = damaged + counts(1320, 0, 0, 0) + counts(2640, 0, 0, 0)
    whole = stream[: len(first)]
    assume(whole == first or sum(whole[2:-1]) % 256 != whole[-1])  # one in 256 has its sum
    reports = [report for byte in stream for report in board.feed(bytes((byte,)))]
    assert board.frames == len(reports)
    assert board.refused > 0 or len(reports) == 3
    assert [report.angles[0] / math.tau for report in reports[-2:]] == pytest.approx([1.0, 2.0])


CYCLE_S, TICK_S, COUNT = 0.041, 0.01, math.tau / 1320
SPAN = 2**32 * COUNT


@pytest.fixture
def wheels():
    return WheelEstimator(CYCLE_S, 30.8)


def drive(wheels, angle, until_s, jitter_s=0.0, lost=frozenset()):
    """Yield time and speed at each tick of a wheel whose angle is `angle(t)`."""
    draw, arrivals, number = random.Random(1), [], 0
    for tick in range(1, round(until_s / TICK_S) + 1):
        now_s = tick * TICK_S
        while (sent_s := number * CYCLE_S) <= now_s:
            if number not in lost:
                counted = math.floor(angle(sent_s) / COUNT) * COUNT
                arrivals.append((sent_s + jitter_s * draw.random(), counted))
            number += 1
        while arrivals and arrivals[0][0] <= now_s:
            arrived_s, counted = arrivals.pop(0)
            wheels.take(WheelAngles((counted,) * 4, SPAN), arrived_s)
        _, speeds = wheels.advance(now_s, TICK_S)
        yield now_s, speeds.front_left


def test_a_steady_speed_is_measured_despite_jitter(wheels):
    run = drive(wheels, lambda t: 10.0 * t, 2.0, 0.015)
    speeds = [speed for now_s, speed in run if now_s > 0.5]
    quantum = COUNT / CYCLE_S  # of the measured speed; jitter moves the angle by speed times delay
    assert max(abs(v - 10.0) for v in speeds) < 2 * quantum + 10.0 * 0.015 / CYCLE_S
    assert sum(speeds) / len(speeds) == pytest.approx(10.0, abs=0.1 * quantum + 0.02)
    after = [wheels.advance(2.0 + n * TICK_S, TICK_S)[1] for n in range(30)]
    assert max(map(abs, after[-1])) < 0.1  # no report for more than two cycles: it stands


def test_the_sum_of_the_speeds_follows_the_encoders(wheels):
    def angle(t):  # the integral of 8 sin(2t) + 3
        return 4.0 * (1.0 - math.cos(2.0 * t)) + 3.0 * t

    run = drive(wheels, angle, 30.0, 0.01, lost={100, 101, 300})
    total = sum(speed * TICK_S for _, speed in run)
    # an age of up to two cycles at 11 rad/s, and a count
    assert total == pytest.approx(angle(30.0), abs=2 * CYCLE_S * 11.0 + COUNT)
    assert wheels.jumps == 0


def test_a_count_that_wraps_is_a_small_step(wheels):
    end = 2**31 * COUNT
    wheels.take(WheelAngles((end - 0.1,) * 4, SPAN), 0.0)
    for n in (1, 2):
        wheels.take(WheelAngles((-end + 0.1,) * 4, SPAN), n * CYCLE_S)
    speeds = [wheels.advance(2 * CYCLE_S, TICK_S)[1].front_left for _ in range(100)]
    assert wheels.jumps == 0
    assert sum(speeds) * TICK_S == pytest.approx(0.2, abs=1e-6)  # made up for within a second


@pytest.mark.parametrize(("until", "jumps"), [(11, 1), (20, 2)])
def test_a_jump_of_an_encoder_is_no_motion(wheels, until, jumps):
    """The count of one wheel is wrong from the 10th report on, for one report or for good."""
    for n in range(20):
        turned = 0.2 * n + (500.0 if 10 <= n < until else 0.0)
        wheels.take(WheelAngles((turned, 0.2 * n, 0.2 * n, 0.2 * n), SPAN), n * CYCLE_S)
        wheels.advance(n * CYCLE_S, CYCLE_S)
    assert wheels.jumps == jumps
    assert wheels.angles == pytest.approx((0.2 * 19,) * 4, abs=0.25)  # but for the last step
