"""The wheels between reports: steady, without drift, and not fooled by damaged numbers."""

import math
import random

import pytest
from mecazen_hardware.board import WheelAngles
from mecazen_hardware.wheels import WheelEstimator

CYCLE_S, TICK_S, COUNT = 0.041, 0.01, math.tau / 1320
SPAN = 2**32 * COUNT


def angles(turned):
    counted = math.floor(turned / COUNT) * COUNT
    return WheelAngles((counted,) * 4, SPAN)


def drive(wheels, speed, until_s, jitter_s=0.0, lose=frozenset(), seed=1):
    """Yield time, angle and speed at each tick of a wheel that turns at `speed(t)` from rest."""
    draw = random.Random(seed)
    turned, at, report, sent = 0.0, 0.0, 0.0, 0
    waiting = []
    for tick in range(1, round(until_s / TICK_S) + 1):
        now = tick * TICK_S
        while report <= now:
            if sent not in lose:
                arrival = report + jitter_s * draw.random()
                waiting.append((arrival, angles(turned_at(speed, report))))
            report, sent = report + CYCLE_S, sent + 1
        while waiting and waiting[0][0] <= now:
            arrived, message = waiting.pop(0)
            wheels.take(message, arrived)
        (at, *_), (turned, *_) = wheels.advance(now, TICK_S)
        yield now, at, turned


def turned_at(speed, until_s, step_s=0.001):
    return sum(speed(n * step_s) * step_s for n in range(round(until_s / step_s)))


@pytest.mark.parametrize("jitter_s", [0.0, 0.015])
def test_a_steady_speed_is_measured_despite_jitter(jitter_s):
    wheels = WheelEstimator(CYCLE_S, 30.8)
    speeds = [v for t, _, v in drive(wheels, lambda t: 10.0, 2.0, jitter_s) if t > 0.5]
    quantum = COUNT / CYCLE_S  # of the measured speed; jitter moves the angle by speed times delay
    assert max(abs(v - 10.0) for v in speeds) < 2 * quantum + 10.0 * jitter_s / CYCLE_S
    assert sum(speeds) / len(speeds) == pytest.approx(10.0, abs=0.1 * quantum + 0.02)


def test_the_sum_of_the_speeds_follows_the_encoders():
    wheels = WheelEstimator(CYCLE_S, 30.8)

    def speed(t):
        return 8.0 * math.sin(2.0 * t) + 3.0

    total = sum(v * TICK_S for _, _, v in drive(wheels, speed, 30.0, 0.01, lose={100, 101, 300}))
    # an age of up to two cycles at 11 rad/s, and a count
    assert total == pytest.approx(turned_at(speed, 30.0), abs=2 * CYCLE_S * 11.0 + COUNT)
    assert wheels.jumps == 0


def test_a_count_that_wraps_is_a_small_step():
    wheels = WheelEstimator(CYCLE_S, 30.8)
    end = 2**31 * COUNT
    wheels.take(WheelAngles((end - 0.1,) * 4, SPAN), 0.0)
    for n in (1, 2):
        wheels.take(WheelAngles((-end + 0.1,) * 4, SPAN), n * CYCLE_S)
    speeds = [wheels.advance(2 * CYCLE_S, TICK_S)[1].front_left for _ in range(100)]
    assert wheels.jumps == 0
    assert sum(speeds) * TICK_S == pytest.approx(0.2, abs=1e-6)  # made up for within a second


def test_the_next_report_makes_up_for_a_damaged_number():
    wheels = WheelEstimator(CYCLE_S, 30.8)
    for n in range(10):
        turned = 0.2 * n if n != 5 else 500.0
        wheels.take(WheelAngles((turned,) * 4, SPAN), n * CYCLE_S)
        wheels.advance(n * CYCLE_S, CYCLE_S)
    assert wheels.jumps == 1
    assert wheels.angles[0] == pytest.approx(0.2 * 9, abs=0.21)


def test_an_encoder_that_jumps_for_good_is_no_motion():
    wheels = WheelEstimator(CYCLE_S, 30.8)
    for n in range(20):
        turned = 0.2 * n + (500.0 if n >= 10 else 0.0)
        wheels.take(WheelAngles((turned, 0.2 * n, 0.2 * n, 0.2 * n), SPAN), n * CYCLE_S)
        wheels.advance(n * CYCLE_S, CYCLE_S)
    assert wheels.jumps == 2
    assert wheels.angles[0] == pytest.approx(0.2 * 19, abs=0.25)  # but for the last step


def test_without_reports_the_speed_ends_after_two_cycles():
    wheels = WheelEstimator(CYCLE_S, 30.8)
    list(drive(wheels, lambda t: 10.0, 1.0))
    for n in range(30):
        _, speeds = wheels.advance(1.0 + n * TICK_S, TICK_S)
    assert max(map(abs, speeds)) < 0.1
