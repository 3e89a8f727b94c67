"""Runs that a stranger makes up: they begin nothing, delay nothing, and fill nothing."""

import random
import resource
import threading
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig, RecorderConfig
from mecazen.messages import SimState
from mecazen.schema import OutputFile
from mecazen.wire import Stamp, encode
from mecazen_recorder import recorder as module
from mecazen_recorder import writer
from mecazen_recorder.reader import Recording
from mecazen_recorder.recorder import Recorder
from mecazen_recorder.runs import FIRST_BYTES
from recorder.ticks import stamp_of, tick

FORGED = 70_000
GROWTH_BYTES = 2 * FIRST_BYTES + 20_000_000
"""What waits, and what the file's writer and the index of its chunks take."""


def memory_bytes() -> int:
    """The resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@pytest.fixture
def rig(router, tmp_path):
    """Return a recorder that gets samples by hand, and its queries."""
    asked, may_answer, path = [], threading.Event(), tmp_path / "run.mcap"

    def scenario():
        asked.append(1)
        may_answer.wait()

    with closing(ZenohBus(BusConfig(connect=(router,), namespace="forged"), "client")) as bus:
        recorder = Recorder(bus, RecorderConfig(file=OutputFile(path)), (), scenario, ())

        def tell(key, payload, stamp):
            recorder._take_bytes((), key, payload, "", None if stamp is None else stamp.pack())

        def tell_tick(number, run=7):
            for key, message in tick(number).items():
                tell(key, encode(message), stamp_of(number, run))

        def physics_names(run):
            bus.call = lambda *_: SimState(run=run)

        def wait_for_answers():
            while recorder._answer is not None:
                recorder._answer.result()
                recorder._go_on()

        def end():
            may_answer.set()
            recorder.close()
            return list(Recording(path).samples())

        yield SimpleNamespace(
            bus=bus,
            tell=tell,
            tell_tick=tell_tick,
            physics_names=physics_names,
            wait_for_answers=wait_for_answers,
            asked=asked,
            may_answer=may_answer,
            end=end,
        )
        may_answer.set()


def test_seventy_thousand_made_up_runs_begin_none_and_lose_no_sample(rig):
    rig.may_answer.set()
    numbers = random.Random(1)
    keys = ("cmd_vel", "clock", "diagnostics/viewer", "of/ones/own", "odom")
    before = memory_bytes()
    for number in range(FORGED):
        rig.tell(numbers.choice(keys), b"{}", Stamp(0, numbers.randrange(8, 2**32), 0))
        if number % 700 == 0:
            rig.tell_tick(number // 700)
    growth = memory_bytes() - before
    real = [sample for sample in rig.end() if sample.stamp.run == 7]
    assert len(real) == 100 * len(tick(0))
    assert len(rig.asked) < 3  # two made-up runs in a thousand would be the same by chance
    assert growth < GROWTH_BYTES
    assert rig.bus.refused.total() > FORGED * 0.999


def test_while_nobody_answers_all_is_kept_in_order_and_nobody_waits(rig):
    for number in range(20):
        rig.tell_tick(number)
    for number in range(20, 40):
        rig.tell_tick(number, run=8)
    assert rig.asked == [1]  # and has not been answered
    samples = rig.end()
    assert [s.key for s in samples] == [*tick(0)] * 40
    assert [s.stamp for s in samples] == [
        stamp_of(n, 7 if n < 20 else 8) for n in range(40) for _ in tick(0)
    ]


def test_the_run_that_physics_names_has_its_place_among_any_number_of_made_up_ones(
    rig, monkeypatch
):
    monkeypatch.setattr(module, "MAX_OTHER_RUNS", 3)
    rig.may_answer.set()
    for number in range(20):
        real = 7 if number < 15 else 8
        rig.physics_names(real)
        rig.tell_tick(0, 100 + number)
        rig.tell_tick(number, real)
        rig.wait_for_answers()
    stamps = [sample.stamp for sample in rig.end()]
    assert {stamp.run for stamp in stamps} == {100, 101, 102, 7, 8}
    assert [stamp for stamp in stamps if stamp.run in {7, 8}] == [
        stamp_of(n, 7 if n < 15 else 8) for n in range(20) for _ in tick(0)
    ]


def test_one_query_decides_about_all_runs_that_waited_for_it(rig, monkeypatch):
    monkeypatch.setattr(module, "MAX_OTHER_RUNS", 0)
    rig.physics_names(7)
    for run in range(100, 200):
        rig.tell_tick(0, run)
    rig.tell_tick(0)
    rig.may_answer.set()
    rig.wait_for_answers()
    assert len(rig.asked) == 3  # about the first made-up run, the second one, and run 7
    assert {sample.stamp.run for sample in rig.end()} == {7}


def test_made_up_keys_leave_room_for_those_of_the_table(rig, monkeypatch):
    monkeypatch.setattr(writer, "MAX_OTHER_CHANNELS", 10)
    for number in range(20):
        rig.tell(f"diagnostics/{number}", b"{}", None)
        rig.tell(f"of/ones/{number}", b"{}", None)
    rig.tell_tick(0)
    samples = rig.end()
    assert len({sample.key for sample in samples}) == 10 + len(tick(0))
