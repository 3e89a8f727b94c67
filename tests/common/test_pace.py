"""The clock keeps pace with those who take every sample, over real sessions on loopback."""

import pytest
from harness import wait
from mecazen.runtime.pace import TICKS_AHEAD, TICKS_APART, Pace, Receipts, receipts
from mecazen.wire import Stamp

TICK_NS = 10_000_000
PATIENCE_S = 0.2


def at(tick, run=1):
    return Stamp(tick * TICK_NS, run, 0)


@pytest.fixture
def clock(zenoh_pair):
    """Return the pace of a clock, and the receipts of a recorder that it knows."""
    pace = Pace(zenoh_pair.near, TICK_NS, PATIENCE_S)
    pace.begin(1)
    taken = Receipts(zenoh_pair.far, "recorder", tick_ns=TICK_NS)
    wait(zenoh_pair.near, lambda: "recorder/every" in zenoh_pair.near.presence.names)
    zenoh_pair.link()
    return pace, taken


def test_the_clock_goes_ahead_by_what_links_hold_and_then_waits_for_receipts(clock, caplog):
    pace, taken = clock
    pace.keep(TICKS_AHEAD)
    taken.reached(at(5))
    pace.keep(TICKS_AHEAD + 5)
    assert not caplog.records


def test_a_receipt_is_sent_every_few_ticks_and_at_the_beginning_of_a_run(clock, zenoh_pair):
    _, taken = clock
    heard = []
    zenoh_pair.near.subscribe(receipts("recorder"), lambda _, s: heard.append(s), every=True)
    zenoh_pair.link()
    for run in (1, 2):
        for tick in range(2 * TICKS_APART + 1):
            taken.reached(at(tick, run))
    zenoh_pair.settle()
    assert heard == [at(n * TICKS_APART, run) for run in (1, 2) for n in range(3)]


def test_without_one_who_is_silent_the_clock_goes_on_and_says_so_once(clock, zenoh_pair, caplog):
    pace, taken = clock
    for tick in (TICKS_AHEAD + 1, TICKS_AHEAD + 2):
        pace.keep(tick)
    (record,) = caplog.records
    assert "going on without recorder" in record.getMessage()
    # its next receipt counts again
    taken.reached(at(TICKS_AHEAD))
    zenoh_pair.settle()
    pace.keep(2 * TICKS_AHEAD + 1)
    assert len(caplog.records) == 2


def test_a_reset_does_not_wait_for_one_who_is_silent(clock, caplog):
    pace, _ = clock
    pace.keep(TICKS_AHEAD + 1, lambda: True)
    assert not caplog.records


def test_receipts_of_another_run_count_nothing(clock, zenoh_pair, caplog):
    pace, taken = clock
    taken.reached(at(100, run=7))
    zenoh_pair.settle()
    pace.keep(TICKS_AHEAD + 1)
    assert caplog.records


def test_nobody_waits_for_one_who_has_gone(open_bus, pair_of, caplog):
    pair = pair_of(open_bus(), open_bus())
    pace = Pace(pair.near, TICK_NS, PATIENCE_S)
    pace.begin(1)
    Receipts(pair.far, "recorder", tick_ns=TICK_NS)
    wait(pair.near, lambda: "recorder/every" in pair.near.presence.names)
    pair.far.close()
    wait(pair.near, lambda: "recorder/every" not in pair.near.presence.names)
    pace.keep(10 * TICKS_AHEAD)
    assert not caplog.records


def test_one_who_joins_in_the_middle_of_a_run_owes_nothing_of_before(zenoh_pair, caplog):
    pace = Pace(zenoh_pair.near, TICK_NS, PATIENCE_S)
    pace.begin(1)
    pace.keep(1000)
    Receipts(zenoh_pair.far, "record")
    wait(zenoh_pair.near, lambda: "record/every" in zenoh_pair.near.presence.names)
    pace.keep(1000 + TICKS_AHEAD)
    assert not caplog.records
