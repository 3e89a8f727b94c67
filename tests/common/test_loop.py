"""The order of turns within a tick, the samples that a step takes, and what becomes of outputs."""

import msgspec
import pytest
from mecazen import keys
from mecazen import messages as m
from mecazen.config import ControllerConfig, RobotConfig, SensorConfig, SimConfig, StartConfig
from mecazen.errors import ConfigError, NodeError, RefusedError, explaining
from mecazen.geometry import Twist2D
from mecazen.graph import Graph
from mecazen.keys import Topic
from mecazen.loop import AHEAD_AT_MOST, Loop, Slot, Turn, awaited_services, turns_of
from mecazen.messages import String
from mecazen.node import Node
from mecazen.programs import graph_of
from mecazen.row import Row, due, every, latest
from mecazen.wire import Stamp

TICK_NS = 10_000_000
LOCKSTEP = SimConfig(mode="lockstep")
A, B = (Topic(key, String, "") for key in ("a", "b"))


def turns_with(scenario, *more: Row, **changes) -> dict[str, Turn]:
    """Return the turns of a scenario with further rows in its graph, by name and in order."""
    changed = msgspec.structs.replace(scenario, **changes)
    graph = Graph((*graph_of(changed).rows, *more), changed.names)
    return {turn.name: turn for turn in turns_of(changed, graph)}


def slot_of(turn: Turn, key: str) -> Slot:
    return next(slot for slot in turn.slots if slot.on_bus.key == key)


def test_a_turn_comes_after_those_that_it_waits_for_and_the_clock_first(scenario):
    for sim in (LOCKSTEP, SimConfig(mode="real_time")):
        turns = turns_with(scenario, sim=sim, sensor=SensorConfig(kind="fused"))
        order = list(turns)
        assert order[0] == "clock"
        for name, turn in turns.items():
            for slot in turn.slots:
                if slot.giver is not None and slot.rule != "latest":
                    comes_before = order.index(slot.giver.name) < order.index(name)
                    assert comes_before is not bool(slot.lag)


def test_in_lockstep_the_latest_sample_of_a_node_is_waited_for(scenario):
    first = Row("first", inputs=(every(keys.CLOCK),), outputs=(A,))
    second = Row("second", inputs=(every(keys.CLOCK), latest(A)))
    for mode, rule in (("real_time", "latest"), ("lockstep", "due")):
        turns = turns_with(scenario, second, first, sim=SimConfig(mode=mode))
        assert slot_of(turns["second"], "a").rule == rule
    assert list(turns).index("first") < list(turns).index("second")


def test_nothing_waits_for_a_topic_that_no_node_gives(scenario):
    turns = turns_with(scenario, services=("physics", "controller"), sim=LOCKSTEP)
    assert slot_of(turns["controller"], "cmd_vel").rule == "latest"
    assert slot_of(turns["physics"], "target/odom").rule == "latest"
    assert slot_of(turns["physics"], "joint_command").rule == "due"


def test_a_turn_is_as_deep_as_the_chain_of_turns_that_it_waits_for(scenario):
    turns = turns_with(scenario, sim=LOCKSTEP)
    depths = {name: turn.depth() for name, turn in turns.items()}
    expected = {"clock": 0, "physics": 1, "odometry": 2, "target": 2, "follower": 3}
    assert depths == {**expected, "controller": 4}


def test_nodes_that_wait_for_each_other_are_refused(scenario):
    one = Row("one", inputs=(every(keys.CLOCK), latest(A)), outputs=(B,))
    two = Row("two", inputs=(every(B),), outputs=(A,))
    assert {"one", "two"} <= turns_with(scenario, one, two).keys()
    circle = "(one waits for two waits for one|two waits for one waits for two): no step of theirs"
    with pytest.raises(ConfigError, match=circle):
        turns_with(scenario, one, two, sim=LOCKSTEP)
    itself = Row("itself", inputs=(every(keys.CLOCK), due(A)), outputs=(A,))
    with pytest.raises(ConfigError, match=r"^itself waits for itself: "):
        turns_with(scenario, itself)


def test_who_uses_the_sample_of_the_tick_before_comes_before_its_giver(scenario):
    giver = Row("giver", inputs=(every(A),), outputs=(B,))
    user = Row("user", inputs=(every(keys.CLOCK), due(B, before=True)), outputs=(A,))
    for rows in ((giver, user), (user, giver)):
        turns = list(turns_with(scenario, *rows, sim=LOCKSTEP))
        assert turns.index("user") < turns.index("giver")


def test_a_turn_comes_when_all_samples_that_trigger_it_do(scenario):
    tenth = Row("tenth", inputs=(every(keys.CLOCK),), outputs=(A,), rates={A.key: 10.0})
    both = Row("both", inputs=(every(keys.ODOM), every(A)))
    never = Row("never", inputs=(latest(keys.ODOM),))
    slow = ControllerConfig(update_rate_hz=25.0)  # every 4th tick of 10 ms
    turns = turns_with(scenario, tenth, both, never, controller=slow)
    periods = {name: turn.period for name, turn in turns.items()}
    assert [periods[name] for name in ("physics", "odometry", "controller")] == [1, 1, 1]
    # samples of every 4th and of every 10th tick meet every 20th
    assert (periods["follower"], periods["never"], periods["both"]) == (4, 0, 20)
    assert turns["odometry"].outputs[keys.ODOM].period == 4
    with pytest.raises(ConfigError, match=r"^controller.update_rate_hz = 30 must divide"):
        turns_with(scenario, controller=ControllerConfig(update_rate_hz=30.0))


def test_the_world_waits_for_no_listener(scenario):
    listener = Row("listener", inputs=(every(keys.ODOM),))
    driver = Row("driver", inputs=(every(keys.CLOCK),), outputs=(keys.TARGET_CMD_VEL,))
    everyone = {"physics", "controller", "target", "follower"}
    for mode, awaited in (("real_time", everyone), ("lockstep", everyone | {"driver"})):
        turns = turns_with(scenario, listener, driver, sim=SimConfig(mode=mode))
        assert awaited_services(turns.values()) == awaited


def test_each_robot_has_its_turns_and_shared_nodes_see_all_by_name(scenario):
    robots = (RobotConfig("one"), RobotConfig("two", start=StartConfig(y_m=2.0)))
    turns = turns_with(scenario, robots=robots, services=("physics", "controller"))
    assert turns.keys() == {
        *("clock", "physics", "one/odometry", "two/odometry", "one/controller", "two/controller")
    }
    assert turns["two/odometry"].service == "two/controller"
    keys_of = {slot.topic.key for slot in turns["physics"].slots}
    assert {"one/joint_command", "two/joint_command"} <= keys_of
    clocks = [topic.key for topic in turns["clock"].outputs]
    assert clocks[:3] == ["clock", "one/clock", "two/clock"]
    # a robot's own node knows its topics without the name
    (states,) = turns["two/odometry"].slots
    assert (states.topic, states.on_bus.key) == (keys.JOINT_STATES, "two/joint_states")
    assert states.giver is turns["physics"]


@pytest.mark.parametrize(
    ("rule", "period", "lag", "tick", "last", "awaited"),
    [
        (latest, 1, 0, 5, 4, None),
        (every, 1, 0, 5, 4, 5),
        (every, 1, 0, 0, None, 0),
        # every 4th tick, by a step of every tick: awaited in its tick only
        (due, 4, 0, 8, 7, 8),
        (due, 4, 0, 9, 8, None),
        # ... by a step that was not made in that tick: still awaited in the next one
        (due, 4, 0, 9, 7, 8),
        (due, 4, 0, 10, 5, 8),
        # a node that joins late does not wait for what was due before
        (due, 4, 0, 9, None, None),
        (due, 4, 0, 8, None, 8),
        # the world takes the answers to the tick before, and none in its first
        (due, 1, 1, 0, None, None),
        (due, 1, 1, 1, 0, 0),
        (due, 4, 1, 5, 4, 4),
        (due, 4, 1, 6, 5, None),
    ],
)
def test_a_step_waits_for_the_newest_sample_due_since_the_last_step(
    rule, period, lag, tick, last, awaited
):
    row_input = due(A, before=True) if lag else rule(A)
    slot = Slot(A, A, row_input, row_input.rule)
    slot.period, slot.last = period, last
    slot.expect(tick)
    assert slot.awaited == awaited
    assert slot.is_missing == (awaited is not None)


def test_no_number_of_samples_ahead_fills_the_memory():
    slot = Slot(A, A, due(A), "due")
    slot.keeps_all = True
    for tick in range(AHEAD_AT_MOST + 5):
        slot.receive(String(), Stamp(tick * TICK_NS, 1, 9), tick)
    assert len(slot.waiting) == AHEAD_AT_MOST
    assert slot.count == AHEAD_AT_MOST + 5


class Toy(Node):
    """Gives a command; the method with the name `fails_in` raises."""

    fails_in = ""
    outputs: object = {keys.CMD_VEL: m.Twist()}

    def __init__(self, scenario):
        super().__init__(scenario)
        self.configured = 0
        self.run("__init__")

    def run(self, where):
        if where == self.fails_in:
            raise ZeroDivisionError("by\nzero")

    def reset(self, seed):
        self.run("reset")

    def step(self, tick, inputs):
        self.run("step")
        return self.outputs

    def configure(self, scenario):
        super().configure(scenario)
        self.configured += 1
        self.run("configure")


@pytest.fixture
def toy_turn(scenario):
    """Return a turn of the toy as a node of the user or of ours, and its loop."""

    def make(*, is_user):
        programs = {"mine": "my.py:Toy"} if is_user else {}
        changed = msgspec.structs.replace(scenario, programs=programs)
        row = Row("mine", inputs=(every(keys.ODOM),), outputs=(keys.CMD_VEL,))
        (turn,) = turns_of(changed, Graph((row,)))
        turn.make(Toy, changed)
        turn.puts[keys.CMD_VEL] = lambda *_: None
        return turn, Loop([turn], TICK_NS, lambda *_: None)

    return make


def step(turn, loop):
    turn.slots[0].hand_over(m.Odometry(), 0)
    loop.step(0, Stamp(0, 0, 0), lambda _: True)


CALLS = {
    "__init__": lambda *_: None,
    "reset": lambda turn, _: turn.reset(1),
    "step": step,
    "configure": lambda turn, _: turn.configure(msgspec.structs.replace(turn.scenario, seed=9), 9),
}
"""A call of each method of a node."""


@pytest.mark.parametrize("where", CALLS)
def test_a_mistake_in_a_user_node_is_one_line_with_its_place(toy_turn, monkeypatch, where):
    monkeypatch.setattr(Toy, "fails_in", where)
    line = rf"^mine: ZeroDivisionError: by zero \(.*test_loop.py:\d+ {where} > .*:\d+ run\)$"
    with pytest.raises(NodeError, match=line):
        CALLS[where](*toy_turn(is_user=True))
    with pytest.raises(ZeroDivisionError):  # a mistake of ours has its traceback
        CALLS[where](*toy_turn(is_user=False))


@pytest.mark.parametrize("error", [ConfigError("no"), RefusedError("no"), NodeError("no")])
def test_errors_that_explain_themselves_pass(error):
    with pytest.raises(type(error), match=r"^no$"), explaining("mine"):
        raise error


@pytest.mark.parametrize(
    ("outputs", "expected"),
    [
        ("stop", "mine: step must return a mapping of topics to messages, got str"),
        ({keys.FOLLOWER_STATE: m.FollowerState()}, "mine gives follower/state, which is not"),
        ({"cmd_vel": m.Twist()}, "mine: step returns 'cmd_vel', which is no topic"),
        ({keys.CMD_VEL: m.Odometry()}, "mine: step returns cmd_vel as Odometry; it must be Twist"),
        (
            {keys.CMD_VEL: m.Twist.planar(Twist2D(x=float("nan")))},
            "mine gives cmd_vel whose linear velocity nan is out of range",
        ),
    ],
)
def test_what_others_would_refuse_is_refused_from_a_user_node(
    toy_turn, monkeypatch, outputs, expected
):
    step(*toy_turn(is_user=True))
    monkeypatch.setattr(Toy, "outputs", outputs)
    with pytest.raises(NodeError, match=f"^{expected}"):
        step(*toy_turn(is_user=True))


def test_a_node_is_configured_only_where_its_scenario_has_changed(toy_turn, scenario):
    turn, _ = toy_turn(is_user=False)
    for seed in (turn.scenario.seed, 9, 9):
        turn.configure(msgspec.structs.replace(turn.scenario, seed=seed), 9)
    assert turn.running.configured == 1
    assert turn.running.scenario.seed == turn.scenario.seed == 9
