"""Which samples make up a step of a node."""

import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.keys import Topic
from mecazen.messages import String
from mecazen.row import Input, due, every, latest
from mecazen.runtime.join import Join, make_join
from mecazen.wire import Stamp

TICK_NS = 10_000_000
A, B, D, E, L = (Topic(key, String, "") for key in "abdel")


def join_of(*inputs: Input, whole: bool = False, **periods: int) -> Join:
    """`periods` are those of the due topics, in ticks."""
    periods_ns = {i.topic: periods[i.topic.key] * TICK_NS for i in inputs if i.rule == "due"}
    return make_join(inputs, periods_ns, whole=whole)


def feed(join: Join, script: str) -> list[str]:
    """Put samples, each named by its topic, its tick if it has one, and any mark; return the steps.

    "d3x" is a sample of topic d of tick 3, "d" one without a stamp; "3: a3 d3x" is the step of
    tick 3 with these samples, "3 again: d" the same step done again.
    """
    topics = {topic.key: topic for topic in (A, B, D, E, L)}
    steps, last = [], None
    for name in script.split():
        tick = re.sub(r"\D", "", name)
        stamp = Stamp(int(tick) * TICK_NS, 1, 9) if tick else None
        for made in join.put(topics[name[0]], String(data=name), stamp):
            samples = " ".join(sorted(message.data for message in made.samples.values()))
            again = " again" if made.stamp == last else ""
            last = made.stamp
            steps.append(f"{made.stamp.time_ns // TICK_NS}{again}: {samples}")
    return steps


EVERY, BOTH = (every(A),), (every(A), every(B))
DUE, REVISED = (every(A), due(D)), (every(A), due(D, revises=True))


@pytest.mark.parametrize(
    ("inputs", "script", "steps"),
    [
        # one step for each tick, in order; none without a stamp
        (EVERY, "a0 a1 a1x a0x a a2 a5 a4", ["0: a0", "1: a1", "2: a2", "5: a5"]),
        # of two inputs, for those of one tick
        (BOTH, "a0 b0 b1 a1", ["0: a0 b0", "1: a1 b1"]),
        (BOTH, "a0 b0 a1 a2 b2 b3 a3", ["0: a0 b0", "2: a2 b2", "3: a3 b3"]),
        (BOTH, "b1 a0 a1", ["1: a1 b1"]),
        # what is latest is never awaited, and used once
        ((*EVERY, latest(L)), "l a0 a1 l1 l2 a2", ["0: a0 l", "1: a1", "2: a2 l2"]),
        # what is due every second tick is awaited there and only there
        (DUE, "a0 d0 a1 a2 d2 a3", ["0: a0 d0", "1: a1", "2: a2 d2", "3: a3"]),
        (DUE, "d0 a0 a1 d2 a2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
        # a sample without a stamp is used, and does not end the wait
        (DUE, "d a0 d0", ["0: a0 d0"]),
        (DUE, "a0 d0 a1 a2 d a3", ["0: a0 d0", "1: a1", "2: a2 d", "3: a3"]),
        # the next tick ends it; what is late then neither makes a step nor ends another wait
        (DUE, "a0 a1 d0 a2 d2", ["0: a0", "1: a1", "2: a2 d2"]),
        (DUE, "a0 d0 a1 a2 a3 d2 a4 d4", ["0: a0 d0", "1: a1", "2: a2", "3: a3", "4: a4 d4"]),
        # who joins late does not wait for what was due before
        (DUE, "a5 a6 d6", ["5: a5", "6: a6 d6"]),
        # ticks come every third: what was due at 4 is still due at 6
        (DUE, "a3 d4 a6 d6", ["3: a3", "6: a6 d6"]),
        ((*DUE, due(E)), "a0 e0 d0 a2 d2 a3 e3", ["0: a0 d0 e0", "2: a2 d2", "3: a3 e3"]),
        # a newer sample has the step done again, but not before the step has been done
        (REVISED, "d a0 d0 d0x d a2 d2", ["0: a0 d0", "0 again: d0x", "0 again: d", "2: a2 d2"]),
        (REVISED, "a0 a1 a2 d0 d2", ["0: a0", "1: a1", "2: a2 d2"]),
        (REVISED, "a0 a1 d0 d", ["0: a0", "1: a1", "1 again: d0", "1 again: d"]),
        # one that is ahead of its tick waits for it
        (REVISED, "a0 d0 d2 a1 a2", ["0: a0 d0", "1: a1 d2", "2: a2"]),
    ],
)
def test_each_step_is_made_of_what_its_rules_ask_for(inputs, script, steps):
    assert feed(join_of(*inputs, d=2, e=3), script) == steps


@pytest.mark.parametrize(
    ("inputs", "script", "steps"),
    [
        # one sender is ahead of the other by some ticks: no tick is lost
        (BOTH, "a0 a1 a2 b0 b1 a3 b2 b3", ["0: a0 b0", "1: a1 b1", "2: a2 b2", "3: a3 b3"]),
        # senders of different rates meet at the ticks of both
        (BOTH, "a0 a1 a2 a3 a4 b0 b2 b4", ["0: a0 b0", "2: a2 b2", "4: a4 b4"]),
        (BOTH, "b0 b2 b4 a0 a1 a2 a3 a4", ["0: a0 b0", "2: a2 b2", "4: a4 b4"]),
        # what is due is used at its tick, however much later or earlier it comes
        (DUE, "a0 a1 a2 d0 d2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
        (DUE, "d0 d2 d4 a0 a1 a2 a3", ["0: a0 d0", "1: a1", "2: a2 d2", "3: a3"]),
        # what never came is no more awaited when a later one has come
        (DUE, "a0 d0 a1 a2 a3 a4 d4", ["0: a0 d0", "1: a1", "2: a2", "3: a3", "4: a4 d4"]),
        # who joins late, in the middle of a tick
        (BOTH, "b5 a6 b6", ["6: a6 b6"]),
        (REVISED, "a0 d0 d0x d a1", ["0: a0 d0", "0 again: d0x", "0 again: d", "1: a1"]),
        ((latest(L),), "l0 l1", []),
    ],
)
def test_where_every_sample_comes_each_tick_makes_its_step_in_order(inputs, script, steps):
    assert feed(join_of(*inputs, d=2, whole=True), script) == steps


@pytest.mark.parametrize(
    ("script", "late"),
    [
        ("a0 d0 e0 a1 a2 d2 a3 a4 d4 e4", {"d": 0, "e": 0}),
        ("a0 d0 a1 e0 a2", {"d": 0, "e": 1}),
        ("a0 a1 a2 a3", {"d": 2, "e": 1}),  # e was due at 0 alone
    ],
)
def test_late_samples_are_counted_by_the_ticks_that_closed_without_them(script, late):
    join = join_of(every(A), due(D), due(E), d=2, e=4)
    feed(join, script)
    assert join.late == late


@pytest.mark.parametrize(
    ("ticks", "missed"),
    [((0, 1, 2, 3, 4), 0), ((0, 1, 3, 4, 7), 3), ((0, 2, 4, 6), 0), ((5, 7, 9, 15), 2), ((), 0)],
)
def test_ticks_that_were_never_heard_of_are_counted_by_the_shortest_period(ticks, missed):
    join = join_of(every(A))
    feed(join, " ".join(f"a{tick}" for tick in ticks))
    assert join.missed_ticks == missed


def test_after_a_reset_nothing_is_left_of_the_run_before_but_the_counts():
    join = join_of(*DUE, latest(L), d=2)
    feed(join, "a0 a1 a5 d6 l5 a6x")
    join.reset()
    assert feed(join, "a0 d0 a70 d70") == ["0: a0 d0", "70: a70 d70"]
    assert (join.late, join.missed_ticks) == ({"d": 1}, 3)


PERIOD = st.integers(1, 4)


@given(
    triggers=st.integers(1, 3),
    step=PERIOD,
    dues=st.lists(st.tuples(PERIOD, st.booleans()), max_size=3),
    first=st.integers(0, 5),
    order=st.randoms(use_true_random=False),
)
@pytest.mark.parametrize("whole", [False, True])
def test_whatever_order_the_samples_come_in_the_steps_are_the_same(
    whole, triggers, step, dues, first, order
):
    # the promise of determinism: a tick's samples may overtake each other; ticks only in a
    # whole join, and there too each sender's samples come in their order
    first = 0 if whole else first  # who joins late misses what was due before, in any order
    periods = {Topic(f"every{number}", String, ""): step for number in range(triggers)}
    inputs = [every(topic) for topic in periods]
    for number, (period, revises) in enumerate(dues):
        topic = Topic(f"due{number}", String, "")
        periods[topic] = period
        inputs.append(due(topic, revises=revises))

    def steps(shuffle):
        periods_ns = {topic: period * TICK_NS for topic, period in periods.items()}
        join = make_join(inputs, periods_ns, whole=whole)
        made = []
        last = first + 12
        for begin, end in [(first, last)] if whole else pairwise(range(first, last + 1)):
            ticks = {
                topic: [tick for tick in range(begin, end) if tick % period == 0]
                for topic, period in periods.items()
            }
            topics = [topic for topic, given in ticks.items() for _ in given]
            shuffle(topics)
            for topic in topics:
                tick = ticks[topic].pop(0)
                made += join.put(topic, String(data=f"{tick}"), Stamp(tick * TICK_NS, 1, 9))
        assert not any(join.late.values())
        return made

    expected = steps(lambda _: None)
    assert len(expected) == sum(tick % step == 0 for tick in range(first, first + 12))
    assert steps(order.shuffle) == expected
