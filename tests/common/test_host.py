"""The nodes of a service on a bus: the inputs of each step, and the use of its outputs."""

from dataclasses import replace

import msgspec
import pytest
from harness import Rig, ask_bytes, load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Scenario, SimConfig
from mecazen.errors import BusError, ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario
from mecazen.node import Node
from mecazen.row import Row, due, every, latest
from mecazen.runtime.host import part_of
from mecazen.wire import RefusedError, Stamp

INPUTS = (every(keys.ODOM), due(keys.OBSERVATION), latest(keys.TARGET_CMD_VEL))
PLACE = keys.Call("toy/place", m.OdometryRequest, m.Odometry, "where it is")
NO_WORDS = m.Twist.planar(Twist2D(x=-1.0))
"""A message that the toy refuses."""


class Toy(Node):
    """Writes down its steps, and gives the number of each as a speed."""

    ROW = Row("toy", "", INPUTS, (keys.CMD_VEL,), (PLACE,), resets_with=("controller",))

    def __init__(self, scenario):
        super().__init__(scenario)
        self.events = []
        self.closed = False

    def reset(self, seed):
        self.events.append(("reset", seed))

    def step(self, tick, inputs):
        if inputs.get(keys.TARGET_CMD_VEL) == NO_WORDS:
            inputs.refuse(keys.TARGET_CMD_VEL, "not forward")
        ages = inputs.age_s(keys.OBSERVATION), inputs.age_s(keys.TARGET_CMD_VEL)
        assert inputs[keys.ODOM].header.stamp == tick.time == m.Time.from_ns(tick.time_ns)
        self.events.append((tick.number, tick.period_s, *ages))
        return {keys.CMD_VEL: m.Twist.planar(Twist2D(x=float(tick.number)))}

    def answer(self, call, request):
        if request.pose.position.x < 0.0:
            raise RefusedError("behind the start")
        return m.Odometry(child_frame_id=call.key)

    def diagnostics(self):
        return {"events": len(self.events)}

    def close(self):
        self.closed = True


@pytest.fixture
def rig(scenario):
    """A toy in the follower's place, with a frame every fourth tick."""

    def make(kind=Toy, mode="lockstep", **changes):
        sim = SimConfig(mode=mode)
        changed = msgspec.structs.replace(scenario, sim=sim, **changes)
        return Rig("follower", changed, keys.CMD_VEL, kinds={"follower": kind})

    return make


def put_odom(rig, tick, **stamp):
    at = rig.at(tick, **stamp)
    odom = m.planar_odometry(at.time, "odom", "base_link", Pose2D(), Twist2D())
    return rig.put(keys.ODOM, odom, at)


def test_a_step_is_told_its_tick_its_period_and_the_ages_of_what_it_knows(rig):
    rig = rig()
    toy = rig.node
    never = float("inf")
    for tick in (4, 5, 7):
        rig.put(keys.OBSERVATION, m.Observation(), 4) if tick == 5 else None
        rig.put(keys.TARGET_CMD_VEL, m.Twist(), 7) if tick == 7 else None
        (command,) = put_odom(rig, tick) or rig.put(keys.OBSERVATION, m.Observation(), 4)
        assert command.stamp == rig.at(tick)
        assert command.message.linear.x == tick
    assert toy.events == [
        ("reset", 5),  # as the scenario has it
        ("reset", 9),  # as the run has it
        (4, 0.01, 0.0, never),
        (5, 0.01, 0.01, never),  # of tick 4
        (7, 0.02, 0.03, 0.0),
    ]


def test_a_refused_sample_is_counted_and_as_if_it_never_came(rig):
    rig = rig()
    put_odom(rig, 5)
    for tick, said in ((6, m.Twist()), (7, NO_WORDS)):
        rig.put(keys.TARGET_CMD_VEL, said, tick)
        put_odom(rig, tick)
    ages = [event[3] for event in rig.node.events[2:]]
    assert ages == [float("inf"), 0.0, 0.01]
    assert rig.bus.refused == {"target/cmd_vel": 1}


@pytest.mark.parametrize("mode", ["lockstep", "real_time"])
def test_an_outsider_speaks_for_no_node_that_takes_part(rig, mode):
    rig = rig(mode=mode)
    put_odom(rig, 4)
    rig.bus.put_bytes("target/observation", b"{}")
    rig.bus.put_bytes("odom", b"{}")
    put_odom(rig, 5)
    assert rig.bus.refused == {"target/observation": 1, "odom": 1}
    # in lockstep no step is made without the frame of the node that takes part
    ages = [event[2] for event in rig.node.events[2:]]
    assert ages == ([] if mode == "lockstep" else [float("inf")] * 2)


def test_a_node_begins_anew_with_each_run_and_with_a_service_that_it_depends_on(rig):
    rig = rig()
    toy = rig.node
    put_odom(rig, 5)
    put_odom(rig, 5, run=2, seed=10)
    for name in ("target", "controller"):
        for alive in (True, False, True):
            rig.bus.presence.update(name, alive=alive)
    put_odom(rig, 6, run=2, seed=10)
    steps = [event[:2] for event in toy.events[1:]]
    assert steps == [("reset", 9), (5, 0.01), ("reset", 10), (5, 0.01), ("reset", 10), (6, 0.01)]


class ToyOfLegs(Toy):
    """Takes legs, which no node of the scenario publishes, as well."""

    ROW = replace(Toy.ROW, inputs=(*INPUTS, latest(keys.LEGS)))


@pytest.mark.parametrize("mode", ["lockstep", "real_time"])
def test_a_sample_that_no_node_publishes_begins_no_run(rig, mode):
    rig = rig(ToyOfLegs, mode)
    put_odom(rig, 4)
    assert rig.put(keys.LEGS, m.Observation(), rig.at(8, run=77)) == []
    rig.put(keys.OBSERVATION, m.Observation(), 4)
    put_odom(rig, 5)
    assert [event[0] for event in rig.node.events[2:]] == [4, 5]


def test_its_health_has_the_nodes_words_and_what_its_inputs_have_missed(rig):
    rig = rig(mode="real_time")
    for tick in (0, 1, 2, 8, 9, 100):
        put_odom(rig, tick)
    last = rig.health.take()[-1].message
    said = {value.key: value.value for value in last.status[0].values}
    # 0 and 8 were closed without a frame; at 100 the step of 9 is the last that was made
    assert (said["late/target/observation"], said["missed_ticks"]) == ("2", "5")
    assert said["events"] == "7"


def test_queries_are_answered_by_the_node_or_refused_in_its_words(rig):
    bus = rig().bus
    assert bus.call(PLACE, m.OdometryRequest()).child_frame_id == "toy/place"
    with pytest.raises(BusError, match=r"^toy/place: behind the start$"):
        ask_bytes(bus, PLACE, b'{"pose":{"position":{"x":-1}}}')


def test_the_end_of_a_service_is_the_end_of_its_nodes(rig):
    rig = rig()
    rig.driver.host.close()
    assert rig.node.closed
    assert rig.driver.host.stamp == Stamp(0, 0, 5)


ODOMETRY = m.Odometry()
TWO = "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {y_m = 1.5}\n"


def test_a_part_is_of_one_robot_unless_they_share_it(write_scenario):
    loaded = load_scenario(write_scenario(TWO))
    assert part_of("physics", loaded, "") is loaded
    assert part_of("target", loaded, "two") == loaded.of("two")
    with pytest.raises(ConfigError, match=r"^target: of which robot. --robot takes one or two$"):
        part_of("target", loaded, "")
    with pytest.raises(ConfigError, match=r"^--robot one: there is one physics for all robots$"):
        part_of("physics", loaded, "one")


class Follower(Node):
    """Writes down its steps, with the parameter that counts in them."""

    ROW = Row("follower", inputs=(every(keys.ODOM),), outputs=(keys.CMD_VEL,))

    def __init__(self, scenario):
        super().__init__(scenario)
        self.config = scenario.follower
        self.steps = []

    def reset(self, seed):
        self.steps.append("reset")

    def step(self, tick, inputs):
        self.steps.append((tick.number, self.config.standoff_m))
        return {}


@pytest.fixture
def node():
    scenario = Scenario(load_robot(), sim=SimConfig(mode="lockstep"))
    rig = Rig("follower", scenario, kinds={"follower": Follower})
    steps = rig.node.steps

    def put(tick, run=1, topic=keys.ODOM, message=ODOMETRY):
        rig.put(topic, message, rig.at(tick, run))
        made = [*steps]
        steps.clear()
        return made

    def change(tick, run=1, **settings):
        values = tuple(m.Parameter(f"follower.{key}", text) for key, text in settings.items())
        return put(tick, run, keys.PARAMETERS, m.Parameters(parameters=values))

    put.rig, put.change = rig, change
    return put


def test_a_change_counts_from_its_tick_on_however_early_it_is_known(node):
    assert node(4)[-1] == (4, 1.0)
    node.change(6, standoff_m="2")
    assert [node(5), node(6), node(7)] == [[(5, 1.0)], [(6, 2.0)], [(7, 2.0)]]
    node.change(8, standoff_m="2")  # repeated for those who come late
    assert [node(8), node(9)] == [[(8, 2.0)], [(9, 2.0)]]
    assert node(0, run=2) == ["reset", (0, 2.0)]


def test_a_new_run_of_a_restarted_clock_has_no_changes(node):
    node(4)
    node.change(5, standoff_m="2")
    assert node(5) == [(5, 2.0)]
    node.change(0, run=2)
    assert node(0, run=2)[-1] == (0, 1.0)


def test_a_change_that_is_not_allowed_or_has_no_stamp_is_not_taken(node):
    node(4)
    node.change(5, standoff_m="-1")
    node.change(5, nothing="1")
    node.rig.bus.put_bytes("sim/parameters", b"{}")
    assert node(5) == [(5, 1.0)]
    assert node.rig.bus.refused == {"sim/parameters": 2}
