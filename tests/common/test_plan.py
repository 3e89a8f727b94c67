"""The plan: the order of turns within a tick, and which sample each step waits for."""

import msgspec
import pytest
from mecazen import keys
from mecazen.config import ControllerConfig, RobotConfig, SensorConfig, SimConfig, StartConfig
from mecazen.errors import ConfigError
from mecazen.graph import Graph
from mecazen.keys import Topic
from mecazen.messages import String
from mecazen.plan import Need, Plan, compile_plan
from mecazen.programs import graph_of
from mecazen.row import Row, due, every, latest

LOCKSTEP = SimConfig(mode="lockstep")
LOOP = Topic("loop", String, "what closes a circle")
OTHER = Topic("other", String, "what an other node gives")


def plan_of(scenario, *more: Row, **changes) -> Plan:
    """Return the plan of a scenario, with further rows in its graph."""
    changed = msgspec.structs.replace(scenario, **changes)
    return compile_plan(changed, Graph((*graph_of(changed).rows, *more), changed.names))


def names(plan: Plan) -> list[str]:
    return [turn.name for turn in plan.turns]


def needs(plan: Plan, name: str) -> dict[str, Need]:
    """Return the needs of a turn, by their keys on the bus."""
    (turn,) = [turn for turn in plan.turns if turn.name == name]
    return {need.on_bus.key: need for need in turn.needs}


def test_a_turn_comes_after_those_that_it_waits_for_and_the_world_first(scenario):
    expected = ["physics", "odometry", "target", "follower", "controller"]
    for sim in (LOCKSTEP, SimConfig(mode="real_time")):
        assert names(plan_of(scenario, sim=sim)) == expected


def test_the_order_hangs_on_who_waits_and_not_on_the_table(scenario):
    second = Row("second", inputs=(every(OTHER),))
    first = Row("first", inputs=(every(keys.CLOCK),), outputs=(OTHER,))
    assert names(plan_of(scenario, second, first))[-2:] == ["first", "second"]
    # in real time a latest sample is not waited for; in lockstep it is
    second = Row("second", inputs=(every(keys.CLOCK), latest(OTHER)))
    for mode, last in (("real_time", ["second", "first"]), ("lockstep", ["first", "second"])):
        assert names(plan_of(scenario, second, first, sim=SimConfig(mode=mode)))[-2:] == last


def test_every_giver_has_a_lower_number_except_of_what_the_world_takes(scenario):
    plan = plan_of(scenario, sim=LOCKSTEP, sensor=SensorConfig(kind="fused"))
    for turn in plan.turns:
        assert plan.turns[turn.number] is turn
        for need in turn.needs:
            giver = plan.giver(need)
            assert (giver is None) or (giver.number < turn.number) is not turn.is_world
            assert need.lag == turn.is_world


def test_an_input_is_as_deep_as_the_chain_of_turns_that_its_publisher_waits_for(scenario):
    plan = plan_of(scenario, sim=LOCKSTEP)
    world = needs(plan, "physics")
    assert [plan.depth(world[key]) for key in ("target/odom", "joint_command")] == [1, 3]
    assert plan.depth(needs(plan, "controller")["cmd_vel"]) == 2
    assert plan.depth(needs(plan, "target")["ground_truth/odom"]) == 0
    assert plan.depth(needs(plan, "target")["target/cmd_vel"]) == 0  # of no node


def test_a_circle_of_awaited_topics_is_refused_and_one_of_latest_topics_is_not(scenario):
    one = Row("one", inputs=(every(keys.CLOCK), latest(LOOP)), outputs=(OTHER,))
    two = Row("two", inputs=(every(OTHER),), outputs=(LOOP,))
    assert names(plan_of(scenario, one, two))[-2:] == ["one", "two"]
    circle = r"^one waits for two waits for one: no step of theirs would ever be made$"
    with pytest.raises(ConfigError, match=circle):
        plan_of(scenario, one, two, sim=LOCKSTEP)
    itself = Row("itself", inputs=(every(keys.CLOCK), due(LOOP)), outputs=(LOOP,))
    with pytest.raises(ConfigError, match=r"^itself waits for itself: "):
        plan_of(scenario, itself)


def test_who_uses_the_sample_of_the_tick_before_comes_before_its_giver(scenario):
    giver = Row("giver", inputs=(every(LOOP),), outputs=(OTHER,))
    user = Row("user", inputs=(every(keys.CLOCK), due(OTHER, before=True)), outputs=(LOOP,))
    for rows in ((giver, user), (user, giver)):
        plan = plan_of(scenario, *rows, sim=LOCKSTEP)
        assert names(plan)[-2:] == ["user", "giver"]
        before = needs(plan, "user")["other"]
        assert (before.lag, before.awaited_at(0, None), before.awaited_at(5, 4)) == (1, None, 4)


def test_a_turn_comes_when_all_samples_that_trigger_it_do(scenario):
    slow = {"controller": ControllerConfig(update_rate_hz=25.0)}  # every 4th tick of 10 ms
    plan = plan_of(scenario, Row("never", inputs=(latest(keys.ODOM),)), **slow)
    periods = {turn.name: turn.period for turn in plan.turns}
    assert (periods["physics"], periods["odometry"], periods["controller"]) == (1, 1, 1)
    assert (periods["follower"], periods["never"]) == (4, 0)
    # samples of every 4th and of every 10th tick meet every 20th
    tenth = Row("tenth", (), (every(keys.CLOCK),), (OTHER,), rates={OTHER.key: 10.0})
    both = Row("both", inputs=(every(keys.ODOM), every(OTHER)))
    assert plan_of(scenario, tenth, both, **slow).turns[-1].period == 20
    outputs = next(turn for turn in plan.turns if turn.name == "odometry").gives
    assert [(topic, on_bus, period) for topic, on_bus, period in outputs] == [
        (keys.ODOM, keys.ODOM, 4)
    ]


def test_a_rate_that_does_not_divide_the_tick_rate_is_refused(scenario):
    with pytest.raises(ConfigError, match=r"^controller.update_rate_hz = 30 must divide"):
        plan_of(scenario, controller=ControllerConfig(update_rate_hz=30.0))


def test_nothing_waits_for_a_topic_that_no_node_gives(scenario):
    alone = plan_of(scenario, services=("physics", "controller"), sim=LOCKSTEP)
    commands = needs(alone, "controller")["cmd_vel"]
    assert (commands.rule, commands.giver) == ("latest", None)
    # the world advances without a person; a node of rule `every` makes no step
    assert needs(alone, "physics")["target/odom"].rule == "latest"
    assert needs(alone, "physics")["joint_command"].rule == "every"


def test_the_world_goes_on_without_those_whom_it_does_not_wait_for(scenario):
    listener = Row("listener", inputs=(every(keys.ODOM),))
    driver = Row("driver", inputs=(every(keys.CLOCK),), outputs=(keys.TARGET_CMD_VEL,))
    everyone = {"physics", "controller", "target", "follower"}
    for mode, awaited in (("real_time", everyone), ("lockstep", everyone | {"driver"})):
        plan = plan_of(scenario, listener, driver, sim=SimConfig(mode=mode))
        assert {"listener", "driver"} <= set(names(plan))
        assert plan.awaited() == awaited


def test_each_robot_has_its_turns_and_shared_nodes_see_all_by_name(scenario):
    robots = (RobotConfig("one"), RobotConfig("two", start=StartConfig(y_m=2.0)))
    plan = plan_of(scenario, robots=robots, services=("physics", "controller"))
    assert names(plan) == [
        *("physics", "one/odometry", "two/odometry", "one/controller", "two/controller")
    ]
    physics, _, odometry, *_ = plan.turns
    assert {"one/joint_command", "two/joint_command"} <= needs(plan, "physics").keys()
    assert [on_bus.key for _, on_bus, _ in physics.gives][:3] == ["clock", "one/clock", "two/clock"]
    # a robot's own node knows its topics without the name
    (states,) = odometry.needs
    assert (states.topic, states.on_bus.key, states.robot) == (
        keys.JOINT_STATES,
        "two/joint_states",
        "two",
    )
    assert [turn.name for turn in plan.of([("controller", "two")])] == [
        *("two/odometry", "two/controller")
    ]
    assert plan.giver(states) is physics


def need(rule="due", period=1, lag=0) -> Need:
    return Need(LOOP, LOOP, "", rule, 0, period, lag, revises=False)


@pytest.mark.parametrize(
    ("one", "tick", "last", "awaited"),
    [
        (need("latest"), 5, 4, None),
        (need("every"), 5, 4, 5),
        (need("every"), 0, None, 0),
        # every 4th tick, by a step of every tick: awaited in its tick only
        (need(period=4), 8, 7, 8),
        (need(period=4), 9, 8, None),
        # ... by a step that was not made in that tick: still awaited in the next one
        (need(period=4), 9, 7, 8),
        (need(period=4), 10, 5, 8),
        # one that joins late does not wait for what was due before
        (need(period=4), 9, None, None),
        (need(period=4), 8, None, 8),
        # the world takes the answers to the tick before, and none to its first
        (need("every", lag=1), 0, None, None),
        (need("every", lag=1), 1, 0, 0),
        (need(period=4, lag=1), 5, 4, 4),
        (need(period=4, lag=1), 6, 5, None),
        (need(period=4, lag=1), 8, 7, None),
    ],
)
def test_a_step_waits_for_the_newest_sample_that_is_due_since_the_last_step(
    one, tick, last, awaited
):
    assert one.awaited_at(tick, last) == awaited
