"""Which samples make up a step, and when a worker makes it."""

import re
from types import SimpleNamespace

import pytest
from harness import load_robot
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import Scenario, SimConfig
from mecazen.graph import Graph
from mecazen.keys import Topic
from mecazen.loop import Loop, turns_of
from mecazen.messages import String
from mecazen.row import Input, Row, due, every, latest
from mecazen.runtime.worker import Worker
from mecazen.wire import Stamp

TICK_NS = 10_000_000
A, B, D, E, L = (Topic(key, String, "") for key in "abdel")
EVERY, BOTH = (every(A),), (every(A), every(B))
DUE, REVISED = (every(A), due(D)), (every(A), due(D, revises=True))


class Toy:
    """A node whose inputs come from other processes; it writes down its steps."""

    def __init__(self, inputs, lockstep, **periods):
        self.scenario = Scenario(
            load_robot(), sim=SimConfig(mode="lockstep" if lockstep else "real_time")
        )
        topics = tuple(i.topic for i in inputs if i.topic is not L)
        periods = {topic.key: periods.get(topic.key, 1) for topic in topics}
        rates = {key: 100.0 / period for key, period in periods.items()}
        giver = Row("giver", outputs=topics, rates=rates)
        rows = (giver, Row("toy", inputs=tuple(inputs)))
        turn = turns_of(self.scenario, Graph(rows))[-1]
        turn.make(lambda _: self, self.scenario)
        turn.remote = tuple(turn.slots)
        for slot in turn.slots:
            slot.keeps_all = lockstep
        self.slots = {slot.topic.key: slot for slot in turn.slots}
        self.loop = Loop([turn], TICK_NS, lambda *_: None)
        self.steps = []
        bus = SimpleNamespace(spin_once=lambda *_: False, hears_itself=True)
        self.host = SimpleNamespace(
            loop=self.loop,
            lockstep=lockstep,
            tick_ns=TICK_NS,
            bus=bus,
            next_run=None,
            has_news=False,
            apply_changes=lambda _: None,
            revise=self.loop.revise,
            report_if_due=lambda: None,
        )
        self.worker = Worker(self.host)

    def reset(self, seed):
        self.steps.append("reset")

    def step(self, tick, inputs):
        samples = " ".join(sorted(message.data for message in inputs.samples.values()))
        again = " again" if tick.period_s == 0.0 else ""
        self.steps.append(f"{tick.number}{again}: {samples}")
        return {}

    def put(self, key, data, tick):
        """Deliver a sample, with the stamp of a tick or without."""
        slot = self.slots[key]
        if tick is not None:
            slot.receive(String(data=data), Stamp(tick * TICK_NS, 1, 9), tick)
        elif slot.rule != "every":
            slot.give(String(data=data), 0)
        while self.worker.step():
            pass

    def feed(self, script):
        """Deliver samples, each named by its topic, its tick if it has one, and any mark.

        "d3x" is a sample of topic d of tick 3, "d" one without a stamp; "3: a3 d3x" is the step of
        tick 3 with these samples, "3 again: d" the same step repeated.
        """
        for name in script.split():
            tick = re.sub(r"\D", "", name)
            self.put(name[0], name, int(tick) if tick else None)
        return self.steps


@pytest.mark.parametrize(
    ("inputs", "script", "steps"),
    [
        # one step for each tick, in order
        (EVERY, "a0 a1 a1x a0x a2 a5 a4", ["0: a0", "1: a1", "2: a2", "5: a5"]),
        # of two inputs, for the samples of one tick
        (BOTH, "a0 b0 b1 a1", ["0: a0 b0", "1: a1 b1"]),
        (BOTH, "a0 b0 a1 a2 b2 b3 a3", ["0: a0 b0", "2: a2 b2", "3: a3 b3"]),
        (BOTH, "b1 a0 a1", ["1: a1 b1"]),
        # a latest sample is never awaited, and used once
        ((*EVERY, latest(L)), "l a0 a1 l1 l2 a2", ["0: a0 l", "1: a1", "2: a2 l2"]),
        # a sample due every second tick is awaited in those ticks only
        (DUE, "a0 d0 a1 a2 d2 a3", ["0: a0 d0", "1: a1", "2: a2 d2", "3: a3"]),
        (DUE, "d0 a0 a1 d2 a2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
        # a sample without a stamp is used, and does not end the wait
        (DUE, "a0 d0 a1 a2 d a3", ["0: a0 d0", "1: a1", "2: a2 d", "3: a3"]),
        # the next tick ends the wait; a late sample neither makes a step nor ends another wait
        (DUE, "a0 a1 d0 a2 d2", ["0: a0", "1: a1", "2: a2 d2"]),
        (DUE, "a0 d0 a1 a2 a3 d2 a4 d4", ["0: a0 d0", "1: a1", "2: a2", "3: a3", "4: a4 d4"]),
        # a service that joins late does not wait for what was due before
        (DUE, "a5 a6 d6", ["5: a5", "6: a6 d6"]),
        # a newer sample repeats the step, but not before the step has been made
        (REVISED, "d a0 d0 d0x d a2 d2", ["0: a0 d0", "0 again: d0x", "0 again: d", "2: a2 d2"]),
        (REVISED, "a0 a1 a2 d0 d2", ["0: a0", "1: a1", "2: a2 d2"]),
        (REVISED, "a0 a1 d0 d", ["0: a0", "1: a1", "1 again: d0", "1 again: d"]),
        # a sample that is ahead of its tick waits for it
        (REVISED, "a0 d0 d2 a1 a2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
    ],
)
def test_in_real_time_a_step_takes_what_has_come_before_the_next_tick(inputs, script, steps):
    assert Toy(inputs, lockstep=False, d=2).feed(script) == steps


@pytest.mark.parametrize(
    ("inputs", "script", "steps"),
    [
        # one sender is ahead of the other by some ticks: no tick is lost
        (BOTH, "a0 a1 a2 b0 b1 a3 b2 b3", ["0: a0 b0", "1: a1 b1", "2: a2 b2", "3: a3 b3"]),
        # a due sample is used at its tick, however much later or earlier it comes
        (DUE, "a0 a1 a2 d0 d2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
        (DUE, "d0 d2 d4 a0 a1 a2 a3", ["0: a0 d0", "1: a1", "2: a2 d2", "3: a3"]),
        # a sample that never came is awaited no more when a later one has come
        (DUE, "a0 d0 a1 a2 a3 a4 d4", ["0: a0 d0", "1: a1", "2: a2", "3: a3", "4: a4 d4"]),
        # a service that joins late, in the middle of a tick
        (BOTH, "b5 a6 b6", ["6: a6 b6"]),
        (REVISED, "a0 d0 d0x d a1", ["0: a0 d0", "0 again: d0x", "0 again: d", "1: a1"]),
        ((latest(L),), "l0 l1", []),
    ],
)
def test_in_lockstep_every_tick_waits_for_its_samples(inputs, script, steps):
    assert Toy(inputs, lockstep=True, d=2).feed(script) == steps


@pytest.mark.parametrize(
    ("script", "late"),
    [
        ("a0 d0 e0 a1 a2 d2 a3 a4 d4 e4", {"d": 0, "e": 0}),
        ("a0 d0 a1 e0 a2 a3", {"d": 1, "e": 1}),
        ("a0 a1 a2 a3", {"d": 2, "e": 1}),  # e was due at 0 alone
    ],
)
def test_late_samples_are_counted_by_the_steps_that_were_made_without_them(script, late):
    toy = Toy((every(A), due(D), due(E)), lockstep=False, d=2, e=4)
    toy.feed(script)
    assert {key: toy.slots[key].late for key in "de"} == late


PERIOD = st.integers(1, 4)


@given(
    triggers=st.integers(1, 3),
    step=PERIOD,
    dues=st.lists(st.tuples(PERIOD, st.booleans()), max_size=3),
    order=st.randoms(use_true_random=False),
)
def test_whatever_order_the_senders_come_in_the_steps_are_the_same(triggers, step, dues, order):
    # the promise of determinism: senders may be ahead of each other, each sends in its order
    periods = {Topic(f"every{number}", String, ""): step for number in range(triggers)}
    inputs: list[Input] = [every(topic) for topic in periods]
    for number, (period, revises) in enumerate(dues):
        topic = Topic(f"due{number}", String, "")
        periods[topic] = period
        inputs.append(due(topic, revises=revises))

    def steps(shuffle):
        toy = Toy(inputs, lockstep=True, **{topic.key: n for topic, n in periods.items()})
        ticks = {topic: list(range(0, 12, period)) for topic, period in periods.items()}
        topics = [topic for topic, of in ticks.items() for _ in of]
        shuffle(topics)
        for topic in topics:
            tick = ticks[topic].pop(0)
            toy.put(topic.key, f"{topic.key}.{tick}", tick)
        assert not any(slot.late for slot in toy.slots.values())
        return toy.steps

    expected = steps(lambda _: None)
    assert len(expected) == len(range(0, 12, step))
    assert steps(order.shuffle) == expected
