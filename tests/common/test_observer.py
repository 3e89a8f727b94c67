"""An observer: which samples it takes, and when it begins a run."""

import pytest
from harness import forward
from mecazen.keys import CLOCK, CMD_VEL, JOINT_STATES
from mecazen.messages import Clock, JointState
from mecazen.runtime.observer import Observer
from mecazen.wire import Stamp

TICK_NS = 10_000_000


class Toy(Observer):
    """Keeps its samples, and the seed with which it began."""

    def __init__(self, bus, scenario):
        super().__init__("toy", bus, scenario)
        self.events = []
        self.subscribe(CLOCK, lambda *_: None)
        self.subscribe(CMD_VEL, self.on_cmd_vel)
        self.subscribe(JOINT_STATES, lambda _, stamp: self.events.append(("joints", stamp)))

    def reset(self, seed):
        self.events.append(("reset", seed))

    def on_cmd_vel(self, twist, stamp):
        self.events.append((twist.linear.x, stamp))

    def diagnostics(self):
        return {"events": len(self.events)}


@pytest.fixture(autouse=True)
def toy(bus, scenario):
    return Toy(bus, scenario)


def at(tick, run=1, seed=9):
    return Stamp(tick * TICK_NS, run, seed)


def test_a_new_run_resets_with_its_seed_before_its_first_sample(toy, put):
    put(JOINT_STATES, JointState(), at(0))
    put(CMD_VEL, forward(0.2), at(1))
    put(CLOCK, Clock(), at(0, run=2, seed=10))
    put(CMD_VEL, forward(0.3), at(0, run=2, seed=10))
    first, second = ("reset", 9), ("reset", 10)
    assert toy.events == [
        *(first, ("joints", at(0)), (0.2, at(1))),
        *(second, (0.3, at(0, run=2, seed=10))),
    ]


def test_what_is_left_of_an_ended_run_is_dropped(toy, put):
    for run in (1, 2, 3):
        put(CLOCK, Clock(), at(0, run=run))
    toy.events.clear()
    for run in (0, 1, 2):
        put(CMD_VEL, forward(0.1), at(100, run=run))
        put(JOINT_STATES, JointState(), at(100, run=run))
    assert toy.events == []
    assert toy.stamp == at(0, run=3)


def test_a_key_that_anyone_may_publish_on_neither_begins_a_run_nor_advances_the_clock(toy, put):
    put(CLOCK, Clock(), at(0))
    toy.events.clear()
    put(CMD_VEL, forward(0.1), at(3, run=2))
    put(CMD_VEL, forward(0.2), at(3))
    assert toy.events == [(0.2, at(3))]
    assert toy.stamp == at(0)


def test_an_outsiders_sample_has_no_stamp_and_is_of_any_run(toy, bus, put):
    put(CLOCK, Clock(), at(7))
    bus.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    assert toy.events[1:] == [(0.2, None)]
    assert toy.stamp == at(7)


def test_the_newest_tick_is_known_whatever_comes_late(toy, put):
    put(CLOCK, Clock(), at(5))
    put(JOINT_STATES, JointState(), at(4))
    assert toy.stamp == at(5)
    assert toy.events[-1] == ("joints", at(4))
