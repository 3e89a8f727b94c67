"""The loop: turns in their order, the samples that a step takes, and what becomes of outputs."""

import pytest
from mecazen.keys import Topic
from mecazen.loop import AHEAD_AT_MOST, Loop, Runner, Slot
from mecazen.messages import String
from mecazen.plan import Need, Turn
from mecazen.row import Row
from mecazen.wire import Stamp

TICK_NS = 10_000_000
A, B, OUT = (Topic(key, String, "") for key in ("a", "b", "out"))


def at(tick: int) -> Stamp:
    return Stamp(tick * TICK_NS, 1, 9)


def slot(topic, rule, giver=None, *, keeps_all=True, revises=False, period=1, lag=0) -> Slot:
    """Return an input of a turn: of another process unless a turn of this one gives it."""
    need = Need(topic, topic, "", rule, giver, period, lag, revises)
    return Slot(need, is_remote=giver is None, keeps_all=keeps_all)


class Toy:
    """A node that logs its steps and publishes given messages.

    Args:
        log: Where it writes: its name and the tick, and the messages that it has taken.
        name: Its name; "world" is the world.
        slots: Its inputs.
        gives: What it gives on its topic, by tick; else its name.
    """

    def __init__(self, log, name, *slots, gives=None, period=1, output=OUT):
        self.log, self.name, self.gives, self.output = log, name, gives or {}, output
        self.refuses: Topic | None = None
        self.ticks: list = []
        self.published: list = []
        turn = Turn(0, Row(name), "", period, tuple(s.need for s in slots), (), name == "world")
        self.runner = Runner(turn, self, slots, TICK_NS)
        self.feed()

    def feed(self, *takers: Slot) -> None:
        """Hand what it gives to slots of this process, beside those of others."""
        self.runner.takers[self.output] = (takers, self._put)

    def _put(self, message: String, stamp: Stamp) -> None:
        self.published.append((message.data, stamp))

    def reset(self, seed):
        self.log.append(f"{self.name} reset {seed}")

    def step(self, tick, inputs):
        self.ticks.append((tick.number, tick.time_ns, tick.period_s))
        self.ages = {topic.key: inputs.age_s(topic) for topic in (A, B)}
        taken = sorted(message.data for message in inputs.samples.values())
        self.log.append(f"{self.name}{tick.number} {' '.join(taken)}".strip())
        if self.refuses is not None:
            inputs.refuse(self.refuses, "no")
        data = self.gives.get(tick.number, self.name)
        return {} if data is None else {self.output: String(data=data)}


def loop_of(*toys: Toy, refused=None) -> Loop:
    refused = [] if refused is None else refused
    return Loop(
        [toy.runner for toy in toys], TICK_NS, lambda topic, why: refused.append((topic.key, why))
    )


def lacking(loop: Loop, tick: int) -> list[str]:
    """Make a tick without waiting; return the keys of the samples that were lacking."""
    return [one.need.topic.key for one in loop.step(tick, at(tick))]


def test_turns_are_taken_in_their_order_and_a_later_one_takes_what_an_earlier_one_gave():
    log: list = []
    taken = slot(OUT, "every", 0)
    first, second = Toy(log, "x"), Toy(log, "y", taken, output=B)
    first.feed(taken)
    loop = loop_of(first, second)
    for tick in range(2):
        assert lacking(loop, tick) == []
    assert log == ["x0", "y0 x", "x1", "y1 x"]
    assert first.published == [("x", at(0)), ("x", at(1))]
    assert loop.stamp == at(1)
    assert (taken.count, taken.heard) == (2, 1)


def test_the_world_takes_the_answers_to_the_tick_before():
    log: list = []
    answer, state = slot(B, "every", 1, lag=1), slot(OUT, "every", 0)
    world, node = Toy(log, "world", answer), Toy(log, "n", state, gives={0: "n0", 1: "n1"})
    node.output = B
    world.feed(state)
    node.runner.takers = {B: ((answer,), lambda *_: None)}
    loop = loop_of(world, node)
    for tick in range(3):
        assert lacking(loop, tick) == []
    assert log == ["world0", "n0 world", "world1 n0", "n1 world", "world2 n1", "n2 world"]
    # nothing has been simulated at tick 0; a node's first period is the control period
    assert [period for *_, period in world.ticks] == [0.0, 0.01, 0.01]
    assert [period for *_, period in node.ticks] == [0.01, 0.01, 0.01]


def test_a_node_without_its_trigger_makes_no_step_and_the_missed_ones_are_counted():
    log: list = []
    one = slot(A, "every", 0)
    source = Toy(log, "s", gives={1: None, 2: None}, output=A)
    source.feed(one)
    node = Toy(log, "n", one)
    loop = loop_of(source, node)
    for tick in range(4):
        assert lacking(loop, tick) == []
    assert [line for line in log if line[0] == "n"] == ["n0 s", "n3 s"]
    assert node.ticks[-1] == (3, 3 * TICK_NS, 0.03)
    assert node.runner.missed == 2


def test_a_turn_of_every_third_tick_is_taken_in_these_ticks_only():
    log: list = []
    toy, never = Toy(log, "x", period=3), Toy(log, "never", period=0)
    loop = loop_of(toy, never)
    for tick in range(7):
        assert lacking(loop, tick) == []
    assert log == ["x0", "x3", "x6"]
    assert [period for *_, period in toy.ticks] == [0.01, 0.03, 0.03]
    assert toy.runner.missed == 0


@pytest.mark.parametrize(
    ("rule", "lacks", "steps", "late"),
    [("every", ["a"], [], 1), ("due", ["a"], ["n0"], 1), ("latest", [], ["n0"], 0)],
)
def test_a_sample_of_another_process_is_asked_for_unless_the_latest_will_do(
    rule, lacks, steps, late
):
    log: list = []
    one = slot(A, rule)
    assert lacking(loop_of(Toy(log, "n", one)), 0) == lacks
    assert log == steps
    assert one.late == late


def test_no_number_of_samples_ahead_fills_the_memory():
    one = slot(A, "due")
    for tick in range(AHEAD_AT_MOST + 5):
        one.receive(String(), at(tick), tick)
    assert len(one.waiting) == AHEAD_AT_MOST
    assert one.count == AHEAD_AT_MOST + 5


def test_that_there_is_no_message_ends_the_wait_and_gives_none():
    log: list = []
    one = slot(A, "due")
    one.receive(None, at(0), 0)
    assert lacking(loop_of(Toy(log, "n", one)), 0) == []
    assert log == ["n0"]


def test_a_newer_command_repeats_the_last_step_and_publishes_as_of_its_tick():
    log: list = []
    one = slot(A, "due", revises=True)
    node = Toy(log, "n", one)
    loop = loop_of(node)
    loop.revise()  # before the first step there is nothing to repeat
    one.receive(String(data="a0"), at(0), 0)
    assert lacking(loop, 0) == []
    loop.revise()  # nothing newer has come
    one.receive(String(data="a0x"), at(0), 0)
    loop.revise()
    one.receive(String(data="a1"), at(1), 1)
    loop.revise()  # the sample of the next tick waits for it
    assert lacking(loop, 1) == []
    assert log == ["n0 a0", "n0 a0x", "n1 a1"]
    assert [period for *_, period in node.ticks] == [0.01, 0.0, 0.01]
    assert node.published == [("n", at(0)), ("n", at(0)), ("n", at(1))]
    assert node.runner.missed == 0


def test_who_waits_is_promised_word_where_an_output_is_missing():
    log: list = []
    node = Toy(log, "n", slot(A, "every", 0), gives={2: None, 4: None})
    promised: list = []
    node.runner.promises = ((OUT, 2, promised.append),)
    source = Toy(log, "s", gives={6: None}, output=A)
    source.feed(*node.runner.slots)
    loop = loop_of(source, node)
    for tick in range(7):
        assert lacking(loop, tick) == []
    # it gives nothing at 2 and 4, and makes no step at 6; nothing is due at odd ticks
    assert promised == [at(2), at(4), at(6)]
    assert [stamp for _, stamp in node.published] == [at(0), at(1), at(3), at(5)]


def test_a_refused_sample_is_reported_and_as_if_it_never_came():
    log: list = []
    one, other = slot(A, "latest"), slot(B, "latest")
    node, refused = Toy(log, "n", one, other), []
    loop = loop_of(node, refused=refused)
    node.refuses = A
    for each in (one, other):
        each.give(String(), 0)
    assert [lacking(loop, tick) for tick in (0, 1)] == [[], []]
    assert refused[:1] == [("a", "no")]
    assert node.ages == {"a": float("inf"), "b": 0.01}


def test_a_late_sample_is_as_old_as_the_step_that_it_was_meant_for():
    log: list = []
    late, of_the_tick_before = slot(A, "due", keeps_all=False), slot(B, "due", lag=1)
    node = Toy(log, "n", late, of_the_tick_before)
    loop = loop_of(node)
    late.receive(String(), at(2), 2)
    of_the_tick_before.receive(String(), at(3), 3)
    list(loop.step(4, at(4)))
    assert node.ages == {"a": 0.02, "b": 0.0}
    list(loop.step(5, at(5)))
    assert node.ages == {"a": 0.03, "b": 0.01}


def test_a_reset_leaves_nothing_of_the_run_before():
    log: list = []
    one = slot(A, "due", period=2)
    node = Toy(log, "n", one)
    loop = loop_of(node)
    one.receive(String(data="old"), at(0), 0)
    assert [lacking(loop, tick) for tick in (0, 3)] == [[], ["a"]]
    one.receive(String(data="ahead"), at(8), 8)
    node.runner.reset(4)
    log.clear()
    assert lacking(loop, 8) == ["a"]
    assert log == ["n8"]
    assert node.ages["a"] == float("inf")
    assert node.ticks[-1][2] == 0.01
