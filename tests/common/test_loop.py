"""The order of turns within a tick, their periods, and the rules of their inputs."""

import msgspec
import pytest
from mecazen import keys
from mecazen.config import ControllerConfig, RobotConfig, SensorConfig, SimConfig, StartConfig
from mecazen.errors import ConfigError
from mecazen.graph import Graph
from mecazen.keys import CLOCK, ODOM, Topic
from mecazen.loop import awaited_services, turns_of
from mecazen.messages import String
from mecazen.programs import graph_of
from mecazen.row import Row, due, every, latest

LOCKSTEP, REAL_TIME = (SimConfig(mode=mode) for mode in ("lockstep", "real_time"))
A, B = (Topic(key, String, "") for key in ("a", "b"))


def turns_with(scenario, *more, **changes):
    """Return the turns of a scenario with further rows in its graph, by name and in order."""
    changed = msgspec.structs.replace(scenario, **{"sim": LOCKSTEP, **changes})
    graph = Graph((*graph_of(changed).rows, *more), changed.names)
    return {turn.name: turn for turn in turns_of(changed, graph)}


def row(name, *inputs, gives=(), **rates):
    return Row(name, inputs=inputs, outputs=tuple(gives), rates=rates)


@pytest.mark.parametrize("sim", [LOCKSTEP, REAL_TIME])
def test_a_turn_follows_the_turns_that_it_waits_for(scenario, sim):
    turns = turns_with(scenario, sim=sim, sensor=SensorConfig(kind="fused"))
    order = list(turns)
    assert order[0] == "clock"
    for name, turn in turns.items():
        for slot in turn.slots:
            if slot.giver is not None and slot.rule != "latest":
                comes_before = order.index(slot.giver.name) < order.index(name)
                assert comes_before is not bool(slot.lag)


def test_nodes_that_wait_for_each_other_are_refused(scenario):
    rows = row("first", every(CLOCK), latest(A), gives=[B]), row("second", every(B), gives=[A])
    assert {"first", "second"} <= turns_with(scenario, *rows, sim=REAL_TIME).keys()
    circle = "(first waits for second waits for first|second waits for first waits for second): no"
    with pytest.raises(ConfigError, match=circle):
        turns_with(scenario, *rows)
    with pytest.raises(ConfigError, match=r"^itself waits for itself: "):
        turns_with(scenario, row("itself", every(CLOCK), due(A), gives=[A]))


def test_a_user_of_the_sample_before_precedes_its_giver(scenario):
    giver = row("giver", every(A), gives=[B])
    user = row("user", every(CLOCK), due(B, before=True), gives=[A])
    for rows in ((giver, user), (user, giver)):
        turns = list(turns_with(scenario, *rows))
        assert turns.index("user") < turns.index("giver")


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
    with pytest.raises(ConfigError, match=r"^controller.update_rate_hz = 30 must divide"):
        turns_with(scenario, controller=ControllerConfig(update_rate_hz=30.0))


def test_the_world_waits_for_a_chain_of_turns_but_no_listener(scenario):
    driver = row("driver", every(CLOCK), gives=[keys.TARGET_CMD_VEL])
    services = {"physics", "controller", "target", "follower"}
    for sim, awaited in ((REAL_TIME, services), (LOCKSTEP, services | {"driver"})):
        turns = turns_with(scenario, row("listener", every(ODOM)), driver, sim=sim)
        assert awaited_services(turns.values()) == awaited
    chain = ("clock", "physics", "odometry", "follower", "controller")
    assert [turns[name].depth() for name in chain] == [0, 1, 2, 3, 4]
    assert turns["target"].depth() == 2


def test_a_node_of_one_robot_names_its_topics_without_the_robot(scenario):
    robots = (RobotConfig("red"), RobotConfig("blue", start=StartConfig(y_m=2.0)))
    turns = turns_with(scenario, robots=robots, services=("physics", "controller"))
    each = {f"{robot}/{name}" for robot in ("red", "blue") for name in ("odometry", "controller")}
    assert turns.keys() == {"clock", "physics", *each}
    inputs = {slot.topic.key for slot in turns["physics"].slots}
    assert {"red/joint_command", "blue/joint_command"} <= inputs
    (states,) = turns["blue/odometry"].slots
    assert (states.topic, states.on_bus.key) == (keys.JOINT_STATES, "blue/joint_states")
    assert states.giver is turns["physics"]
