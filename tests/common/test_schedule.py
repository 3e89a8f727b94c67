"""When a tick is due on the wall clock."""

import pytest
from mecazen.runtime.schedule import Schedule


@pytest.fixture
def schedule(wall):
    """10 ms a tick at double speed."""
    return Schedule(0.01, 2.0)


def test_due_dates_count_from_the_beginning_so_waiting_too_long_never_adds_up(schedule, wall):
    for tick in range(100):
        schedule.published(tick)
        wall.now += schedule.wait_s(tick, answered=True) + 0.001  # 1 ms late, each time
    assert wall.now == pytest.approx(100.0 + 100 * 0.005 + 0.001)


def test_who_is_behind_catches_up_but_gives_the_others_half_a_period(schedule, wall):
    wall.now += 0.1
    schedule.published(3)
    assert schedule.wait_s(3, answered=True) < 0.0
    assert schedule.wait_s(3, answered=False) == pytest.approx(0.0025)


def test_who_is_behind_by_more_than_a_second_begins_anew(schedule, wall):
    wall.now += 1.0
    schedule.published(0)
    assert schedule.wait_s(0, answered=True) == pytest.approx(-0.995)
    wall.now += 0.01
    schedule.published(1)
    assert schedule.wait_s(1, answered=True) == pytest.approx(0.005)


def test_the_real_time_factor_is_known_from_the_first_tick_on(schedule, wall):
    assert schedule.rtf == 0.0
    wall.now += 0.001  # a fast run in lockstep may end before a second has passed
    schedule.published(1)
    assert schedule.rtf == pytest.approx(10.0)


def test_the_real_time_factor_is_that_of_the_last_second(schedule, wall):
    for tick in range(102):  # half of the double speed that was asked for
        wall.now = 100.0 + 0.01 * tick
        schedule.published(tick)
    assert schedule.rtf == pytest.approx(1.0)
    for tick in range(102, 202):
        wall.now += 0.02
        schedule.published(tick)
    assert schedule.rtf == pytest.approx(0.5, abs=0.02)
