"""Turns within a tick: their order and periods, and the samples of each step."""

import re

import msgspec
import pytest
from harness import Rig, load_robot
from hypothesis import given, settings
from hypothesis import strategies as st
from mecazen import keys
from mecazen.config import (
    ControllerConfig,
    Scenario,
    SimConfig,
)
from mecazen.errors import ConfigError
from mecazen.graph import Graph
from mecazen.keys import CLOCK, ODOM, Topic
from mecazen.loop import awaited_services, turns_of
from mecazen.messages import String
from mecazen.programs import graph_of
from mecazen.robots import join_key
from mecazen.row import Row, due, every, latest
from mecazen.wire import encode
from toys import Toy, user_nodes

A, B, D, L = (Topic(key, String, "", open=key == "d") for key in "abdl")
EVERY, BOTH, DUE = (every(A),), (every(A), every(B)), (every(A), due(D))
REVISED, BEFORE = (every(A), due(D, revises=True)), (every(A), due(D, before=True))
LOCKSTEP, REAL_TIME = (SimConfig(mode=mode) for mode in ("lockstep", "real_time"))


def turns_with(scenario, *more, **changes):
    """Return the turns of a scenario with further rows in its graph, by name and in order."""
    changed = msgspec.structs.replace(scenario, **{"sim": LOCKSTEP, **changes})
    graph = Graph((*graph_of(changed).rows, *more), changed.names)
    return {join_key(turn.row.name, turn.robot): turn for turn in turns_of(changed, graph)}


def row(name, *inputs, gives=(), **rates):
    return Row(name, inputs=inputs, outputs=tuple(gives), rates=rates)


def test_nodes_that_wait_for_each_other_are_refused(scenario):
    rows = row("first", every(CLOCK), latest(A), gives=[B]), row("second", every(B), gives=[A])
    assert {"first", "second"} <= turns_with(scenario, *rows, sim=REAL_TIME).keys()
    circle = "(first waits for second waits for first|second waits for first waits for second): no"
    with pytest.raises(ConfigError, match=circle):
        turns_with(scenario, *rows)
    with pytest.raises(ConfigError, match=r"^itself waits for itself: "):
        turns_with(scenario, row("itself", every(CLOCK), due(A), gives=[A]))


def test_a_turn_comes_when_all_its_triggers_do(scenario):
    tenth = row("tenth", every(CLOCK), gives=[A], a=10.0)
    both, never = row("both", every(ODOM), every(A)), row("never", latest(ODOM))
    slow = ControllerConfig(update_rate_hz=25.0)  # every 4th tick of 10 ms
    turns = turns_with(scenario, tenth, both, never, controller=slow)
    periods = {name: turn.period for name, turn in turns.items()}
    assert [periods[name] for name in ("physics", "odometry", "controller")] == [1, 1, 1]
    # samples of every 4th and of every 10th tick coincide every 20th
    assert (periods["follower"], periods["never"], periods["both"]) == (4, 0, 20)
    assert turns["odometry"].outputs[ODOM].period == 4


def test_the_world_waits_for_a_chain_of_turns_but_no_listener(scenario):
    driver = row("driver", every(CLOCK), gives=[keys.TARGET_CMD_VEL])
    services = {"physics", "controller", "target", "follower"}
    for sim, awaited in ((REAL_TIME, services), (LOCKSTEP, services | {"driver"})):
        turns = turns_with(scenario, row("listener", every(ODOM)), driver, sim=sim)
        assert awaited_services(turns.values()) == awaited
    chain = ("clock", "physics", "odometry", "follower", "controller")
    assert [turns[name].depth() for name in chain] == [0, 1, 2, 3, 4]
    assert turns["target"].depth() == 2


class Steps(Toy):
    """Records its steps: the tick, whether it is repeated, and its samples."""

    def reset(self, seed):
        self.steps = []

    def step(self, tick, inputs):
        samples = " ".join(sorted(message.data for message in inputs.samples.values()))
        self.steps.append(f"{tick.number}{'' if tick.period_s else ' again'}: {samples}")
        return {}


def make_rig(inputs, mode, **periods):
    """Return a rig of a toy; other services give its inputs, except L, every n-th tick."""
    rows = [Row("toy", inputs=tuple(inputs))]
    for topic in [i.topic for i in inputs if i.topic is not L]:
        rates = {topic.key: 100.0 / periods.get(topic.key, 1)}
        rows.append(Row(f"giver-{topic.key}", "", (every(L),), (topic,), rates=rates))
    with user_nodes(*rows, base=Steps) as programs:
        scenario = Scenario(load_robot(), tuple(programs), programs, sim=SimConfig(mode=mode))
        return Rig("toy", scenario)


def put(rig, name):
    """Publish a sample named by its topic, its tick if it has a stamp, and any mark: d3x."""
    topic = next(topic for topic in (A, B, D, L) if topic.key == name[0])
    if tick := re.sub(r"\D", "", name):
        rig.put(topic, String(data=name), int(tick))
    else:
        rig.bus.put_bytes(topic.key, encode(String(data=name)))
        rig.take()


REAL_TIME_STEPS = [
    # one step for each tick, in order
    (EVERY, "a0 a1 a1x a0x a2 a5 a4", ["0: a0", "1: a1", "2: a2", "5: a5"]),
    # two inputs trigger a step by samples of one tick
    (BOTH, "a0 b0 a1 a2 b2 b3 a3", ["0: a0 b0", "2: a2 b2", "3: a3 b3"]),
    # a latest sample is never awaited, and used once
    ((*EVERY, latest(L)), "a0 l a1 l1 l2 a2", ["0: a0", "1: a1 l", "2: a2 l2"]),
    # a sample due every second tick is awaited in those ticks only
    (DUE, "a0 d0 a1 a2 d2 a3", ["0: a0 d0", "1: a1", "2: a2 d2", "3: a3"]),
    # a sample without a stamp is used, and does not end the wait
    (DUE, "a0 d0 a1 a2 d a3", ["0: a0 d0", "1: a1", "2: a2 d", "3: a3"]),
    # the next tick ends the wait; a late sample neither makes a step nor ends another wait
    (DUE, "a0 d0 a1 a2 a3 d2 a4 d4", ["0: a0 d0", "1: a1", "2: a2", "3: a3", "4: a4 d4"]),
    # a service that starts late does not wait for samples that were due before
    (DUE, "a5 a6 d6", ["5: a5", "6: a6 d6"]),
    # a newer sample repeats the step, but not before the step has been made
    (REVISED, "d0 a0 d0x d a2 d2", ["0: a0 d0", "0 again: d0x", "0 again: d", "2: a2 d2"]),
    (REVISED, "a0 a1 d0 d", ["0: a0", "1: a1", "1 again: d0", "1 again: d"]),
    # a sample that is ahead of its tick waits for it
    (REVISED, "a0 d0 d2 a1 a2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
]
LOCKSTEP_STEPS = [
    # a sender is ahead of another one by some ticks: no tick is lost
    (BOTH, "a0 a1 a2 b0 b1 a3 b2 b3", ["0: a0 b0", "1: a1 b1", "2: a2 b2", "3: a3 b3"]),
    # a due sample is used at its tick, however late or early it arrives
    (DUE, "a0 a1 a2 d0 d2", ["0: a0 d0", "1: a1", "2: a2 d2"]),
    # a sample is awaited until a later one arrives, also if its tick had no step
    (DUE, "a0 d0 a1 a2 a3 a4 d4", ["0: a0 d0", "1: a1", "2: a2", "3: a3", "4: a4 d4"]),
    (DUE, "a0 d0 a1 a3 d2", ["0: a0 d0", "1: a1", "3: a3 d2"]),
    # a step may use the sample of the tick before, which the first step lacks
    (BEFORE, "a0 a1 d0 a2 a3 d2", ["0: a0", "1: a1 d0", "2: a2", "3: a3 d2"]),
    # a service starts late, in the middle of a tick
    (BOTH, "b5 a6 b6", ["6: a6 b6"]),
    (REVISED, "a0 d0 d0x a1", ["0: a0 d0", "0 again: d0x", "1: a1"]),
]


@pytest.mark.parametrize(
    ("mode", "inputs", "script", "steps"),
    [("real_time", *case) for case in REAL_TIME_STEPS]
    + [("lockstep", *case) for case in LOCKSTEP_STEPS],
)
def test_a_step_takes_the_samples_of_its_tick(mode, inputs, script, steps):
    rig = make_rig(inputs, mode, d=2)
    for name in script.split():
        put(rig, name)
    assert rig.node.steps == steps


PERIOD = st.integers(1, 4)


@settings(max_examples=40)
@given(
    triggers=st.integers(1, 3),
    step=PERIOD,
    dues=st.lists(st.tuples(PERIOD, st.booleans()), max_size=3),
    order=st.randoms(use_true_random=False),
)
def test_steps_do_not_depend_on_the_order_of_senders(triggers, step, dues, order):
    # determinism: a sender may be ahead of another one; each sends in order
    periods = {Topic(f"every{n}", String, ""): step for n in range(triggers)}
    inputs = [every(topic) for topic in periods]
    for n, (period, revises) in enumerate(dues):
        topic = Topic(f"due{n}", String, "")
        periods[topic] = period
        inputs.append(due(topic, revises=revises))

    def steps(shuffle):
        rig = make_rig(inputs, "lockstep", **{topic.key: n for topic, n in periods.items()})
        ticks = {topic: list(range(0, 12, period)) for topic, period in periods.items()}
        senders = [topic for topic in ticks for _ in ticks[topic]]
        shuffle(senders)
        for topic in senders:
            tick = ticks[topic].pop(0)
            rig.put(topic, String(data=f"{topic.key}.{tick}"), tick)
        report = rig.driver.host.services[0].diagnostics()
        assert not any(count for name, count in report.items() if name.startswith("late/"))
        return rig.node.steps

    expected = steps(lambda _: None)
    assert len(expected) == len(range(0, 12, step))
    assert steps(order.shuffle) == expected
