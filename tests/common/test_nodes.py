"""Nodes as the loop steps them: the world by its robots, and a user node with care."""

import msgspec
import pytest
from carts import Carts
from mecazen import keys
from mecazen import messages as m
from mecazen.config import RobotConfig, StartConfig
from mecazen.errors import ConfigError, NodeError, RefusedError
from mecazen.geometry import Twist2D
from mecazen.keys import of_robot
from mecazen.node import Inputs, Node, Tick
from mecazen.plan import Turn, compile_plan
from mecazen.programs import graph_of
from mecazen.row import Row, every
from mecazen.runtime.nodes import Hosted, OwnSteps, WorldSteps, explaining

TICK = Tick(1, 10_000_000, 0.01)
TURN = Turn(0, Row("mine"), "", 1, (), ((keys.CMD_VEL, keys.CMD_VEL, 1),))


class Toy(Node):
    """Gives a command; the method with the name `fails_in` raises."""

    ROW = Row("mine", inputs=(every(keys.ODOM),), outputs=(keys.CMD_VEL,))
    fails_in = ""
    fails_with: Exception = ZeroDivisionError("by\nzero")

    def __init__(self, scenario):
        super().__init__(scenario)
        self.outputs = {keys.CMD_VEL: m.Twist()}
        self.configured = 0
        self.run("__init__")

    def run(self, where):
        if where == self.fails_in:
            raise self.fails_with

    def reset(self, seed):
        self.run("reset")

    def step(self, tick, inputs):
        self.run("step")
        return self.outputs

    def configure(self, scenario):
        super().configure(scenario)
        self.configured += 1
        self.run("configure")

    def diagnostics(self):
        self.run("diagnostics")
        return {}

    def close(self):
        self.run("close")


CALLS = {
    "__init__": lambda _: None,
    "reset": lambda hosted: hosted.steps.reset(1),
    "step": lambda hosted: hosted.steps.step(TICK, Inputs({})),
    "configure": lambda hosted: hosted.configure(msgspec.structs.replace(hosted.scenario, seed=9)),
    "diagnostics": lambda hosted: hosted.diagnostics(),
    "close": lambda hosted: hosted.close(),
}
"""A call of each method of a node."""


@pytest.mark.parametrize("where", CALLS)
def test_a_mistake_in_a_user_node_is_one_line_with_its_place(scenario, monkeypatch, where):
    monkeypatch.setattr(Toy, "fails_in", where)

    def run(*, is_own):
        CALLS[where](Hosted(TURN, Toy, scenario, is_own=is_own))

    line = rf"^mine: ZeroDivisionError: by zero \(.*test_nodes.py:\d+ {where} > .*:\d+ run\)$"
    with pytest.raises(NodeError, match=line):
        run(is_own=True)
    with pytest.raises(ZeroDivisionError):  # a mistake of ours has its traceback
        run(is_own=False)


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
def test_what_others_would_refuse_is_refused_from_a_user_node(scenario, outputs, expected):
    toy = Toy(scenario)
    steps = OwnSteps(toy, TURN)
    assert steps.step(TICK, Inputs({})) is toy.outputs
    toy.outputs = outputs
    with pytest.raises(NodeError, match=f"^{expected}"):
        steps.step(TICK, Inputs({}))


def test_a_node_is_configured_only_where_its_scenario_has_changed(scenario):
    hosted = Hosted(TURN, Toy, scenario, is_own=False)
    for seed in (scenario.seed, 9, 9):
        hosted.configure(msgspec.structs.replace(scenario, seed=seed))
    assert hosted.node.configured == 1
    assert hosted.node.scenario.seed == hosted.scenario.seed == 9


@pytest.fixture
def two(scenario):
    """A scenario of two robots."""
    robots = (RobotConfig("one"), RobotConfig("two", start=StartConfig(y_m=2.0)))
    return msgspec.structs.replace(scenario, robots=robots, services=("physics", "controller"))


def test_a_world_sees_topics_of_each_robot_and_gives_time_to_all(two):
    turn = compile_plan(two, graph_of(two)).turns[0]
    world = Carts(two)
    steps = WorldSteps(world, turn, two.names)
    steps.reset(3)
    commands = {
        of_robot(keys.JOINT_COMMAND, name): m.JointState(velocity=(speed,))
        for name, speed in (("one", 1.0), ("two", -1.0))
    }
    inputs = Inputs(commands)
    outputs = steps.step(TICK, inputs)
    clocks = [of_robot(keys.CLOCK, name) for name in ("", "one", "two")]
    assert [*outputs][:3] == clocks
    assert {outputs[topic] for topic in clocks} == {m.Clock(clock=TICK.time)}
    x = {
        name: outputs[of_robot(keys.GROUND_TRUTH, name)].pose.pose.position.x
        for name in ("one", "two")
    }
    assert x == {"one": 0.01, "two": 0.0}  # the second cart refuses to go backwards
    assert [topic.key for topic, _ in inputs.refused] == ["two/joint_command"]


@pytest.mark.parametrize("states", [None, {}, {"one": {}}, {"one": {}, "two": {}, "three": {}}])
def test_a_world_must_give_the_state_of_each_robot(two, monkeypatch, states):
    monkeypatch.setattr(Carts, "step", lambda *_: states)
    turn = compile_plan(two, graph_of(two)).turns[0]
    with pytest.raises(NodeError, match=r"^physics: step must return the outputs of each robot of"):
        WorldSteps(Carts(two), turn, two.names).step(TICK, Inputs({}))
