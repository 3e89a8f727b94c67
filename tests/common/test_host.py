"""The nodes of a service on a bus: inputs, outputs and health; and what an observer hears."""

import math
import re

import msgspec
import pytest
from harness import SCENARIOS, Rig, error_of, forward
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import StoppedError
from mecazen.config import SimConfig
from mecazen.errors import BusError, ConfigError, NodeError, RefusedError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import (
    CLOCK,
    CMD_VEL,
    JOINT_STATES,
    OBSERVATION,
    ODOM,
    TARGET_CMD_VEL,
    diagnostics,
)
from mecazen.loading import load_scenario
from mecazen.row import Row, due, every, latest
from mecazen.runtime.host import part_of
from mecazen.wire import Stamp
from toys import Toy, Watcher

PLACE, SILENT = (
    keys.Call(f"toy/{name}", m.OdometryRequest, m.Odometry, "") for name in ("place", "silent")
)
BACKWARDS = m.Twist.planar(Twist2D(x=-1.0))
"""A message that the node refuses."""


class Follower(Toy):
    """Records its events, and gives the number of each step as a speed."""

    ROW = Row(
        "toy",
        inputs=(every(ODOM), due(OBSERVATION), latest(TARGET_CMD_VEL), latest(keys.LEGS)),
        outputs=(CMD_VEL,),
        calls=(PLACE, SILENT),
        resets_with=("controller",),
    )

    def __init__(self, scenario):
        super().__init__(scenario)
        self.config, self.sim = scenario.follower, scenario.sim
        self.events = []

    def reset(self, seed):
        self.events.append(("reset", seed))

    def step(self, tick, inputs):
        if inputs.get(TARGET_CMD_VEL) == BACKWARDS:
            inputs.refuse(TARGET_CMD_VEL, "not forward")
        ages = inputs.age_s(OBSERVATION), inputs.age_s(TARGET_CMD_VEL)
        assert inputs[ODOM].header.stamp == tick.time == m.Time.from_ns(tick.time_ns)
        self.events.append((tick.number, tick.period_s, *ages, self.config.standoff_m))
        return {CMD_VEL: m.Twist.planar(Twist2D(x=float(tick.number)))}

    def answer(self, call, request):
        if call is SILENT:
            return super().answer(call, request)
        if request.pose.position.x < 0.0:
            raise RefusedError("behind the start")
        return m.Odometry(child_frame_id=call.key)

    def configure(self, scenario):
        super().configure(scenario)
        self.events.append("configured")

    def diagnostics(self):
        return {"events": len(self.events)}

    def close(self):
        self.events.append("closed")


@pytest.fixture
def rig(scenario):
    """Return a rig of a toy in the follower's place, with a frame every fourth tick."""

    def make(kind=Follower, mode="lockstep", **changes):
        changed = msgspec.structs.replace(scenario, sim=SimConfig(mode=mode), **changes)
        return Rig("follower", changed, CMD_VEL, kinds={"follower": kind})

    return make


def put_odom(rig, tick, **stamp):
    at = rig.at(tick, **stamp)
    return rig.put(ODOM, m.planar_odometry(at.time, "odom", "base", Pose2D(), Twist2D()), at)


def change(rig, tick, run=1, **settings):
    values = tuple(m.Parameter(f"follower.{key}", text) for key, text in settings.items())
    rig.put(keys.PARAMETERS, m.Parameters(parameters=values), rig.at(tick, run))


def steps(rig, column):
    """Return a column of the steps so far: 0 tick, 1 period, 2 and 3 ages, 4 parameter."""
    return [event[column] for event in rig.node.events if len(event) == 5]


def test_a_step_has_its_tick_its_period_and_the_ages_of_its_inputs(rig):
    rig = rig()
    for tick in (4, 5, 7):
        if tick == 5:
            rig.put(OBSERVATION, m.Observation(), 4)
        if tick == 7:
            rig.put(TARGET_CMD_VEL, m.Twist(), 7)
        (command,) = put_odom(rig, tick) or rig.put(OBSERVATION, m.Observation(), 4)
        assert (command.stamp, command.message.linear.x) == (rig.at(tick), tick)
    assert rig.node.events == [
        ("reset", 5),  # the scenario's seed
        ("reset", 9),  # the run's seed
        (4, 0.01, 0.0, math.inf, 1.0),
        (5, 0.01, 0.01, math.inf, 1.0),  # of tick 4
        (7, 0.02, 0.03, 0.0, 1.0),
    ]
    rig.put(TARGET_CMD_VEL, BACKWARDS, 8)  # refused: counted, and as if it never came
    rig.put(OBSERVATION, m.Observation(), 8)
    put_odom(rig, 8)
    assert rig.node.events[-1] == (8, 0.01, 0.0, 0.01, 1.0)
    assert rig.bus.refused == {"target/cmd_vel": 1}


@pytest.mark.parametrize(("mode", "ages"), [("lockstep", []), ("real_time", [math.inf] * 2)])
def test_outsiders_give_no_topic_of_a_node_and_begin_no_run(rig, mode, ages):
    rig = rig(mode=mode)
    put_odom(rig, 4)
    rig.bus.put_bytes("target/observation", b"{}")
    rig.bus.put_bytes("odom", b"{}")
    # a topic that no node gives begins no run
    assert rig.put(keys.LEGS, m.Observation(), rig.at(8, run=77)) == []
    put_odom(rig, 5)
    assert rig.bus.refused == {"target/observation": 1, "odom": 1}
    assert steps(rig, 2) == ages  # in lockstep no step is made without the frame of the target


def test_a_new_run_and_a_return_of_its_service_reset_a_node(rig):
    rig = rig()
    put_odom(rig, 5)
    put_odom(rig, 5, run=2, seed=10)
    for name in ("target", "controller"):
        for alive in (True, False, True):
            rig.bus.presence.update(name, alive=alive)
    put_odom(rig, 9)  # of the ended run
    put_odom(rig, 6, run=2, seed=10)
    events = [event[:2] for event in rig.node.events[1:]]
    assert events == [("reset", 9), (5, 0.01), ("reset", 10), (5, 0.01), ("reset", 10), (6, 0.01)]


def test_health_has_diagnostics_late_samples_and_missed_ticks(rig):
    rig = rig(mode="real_time")
    for tick in (0, 1, 2, 8, 9, 100):
        put_odom(rig, tick)
    values = {pair.key: pair.value for pair in rig.health.take()[-1].message.status[0].values}
    # 0 and 8 were closed without a frame; at 100 the last step made is that of 9
    assert (values["late/target/observation"], values["missed_ticks"]) == ("2", "5")
    assert values["events"] == "7"


def test_a_node_answers_or_refuses_queries_until_it_is_closed(rig):
    rig = rig(programs={"follower": "my.py:Follower"})
    assert rig.bus.call(PLACE, m.OdometryRequest()).child_frame_id == "toy/place"
    with pytest.raises(BusError, match=r"^toy/place: behind the start$"):
        rig.bus.call(PLACE, m.OdometryRequest(pose=m.Pose.planar(Pose2D(x=-1.0))))
    with pytest.raises(NodeError, match="toy/silent is in the row and has no answer"):
        rig.bus.call(SILENT, m.OdometryRequest())
    rig.driver.host.close()
    assert rig.node.events[-1] == "closed"
    assert rig.driver.host.stamp == Stamp(0, 0, 5)


def test_a_change_applies_from_its_tick_on(rig):
    rig = rig(mode="real_time")
    put_odom(rig, 4)
    change(rig, 6, standoff_m="2")
    for tick in (5, 6):
        put_odom(rig, tick)
    change(rig, 7, standoff_m="2")  # repeated for services that start late
    put_odom(rig, 7)
    assert steps(rig, 4) == [1.0, 1.0, 2.0, 2.0]
    rig.driver.host.configure(rig.driver.host.scenario)  # unchanged for this node
    assert rig.node.events.count("configured") == 1
    assert rig.node.config is rig.node.scenario.follower
    change(rig, 9, standoff_m="-1")
    change(rig, 9, nothing="1")
    rig.bus.put_bytes("sim/parameters", b"{}")  # without a stamp
    put_odom(rig, 9)
    assert rig.bus.refused == {"sim/parameters": 2}
    put_odom(rig, 1, run=2)
    change(rig, 2, run=3)  # a restarted clock has no changes
    put_odom(rig, 2, run=3)
    assert steps(rig, 4)[-3:] == [2.0, 2.0, 1.0]


def fail(*_):
    raise ZeroDivisionError("by\nzero")


@pytest.mark.parametrize(
    "method", ["__init__", "reset", "step", "configure", "answer", "diagnostics", "close"]
)
def test_an_error_in_a_user_node_is_one_line_with_its_place(rig, method):
    kind = type("Faulty", (Follower,), {method: fail})

    def run(**programs):
        faulty = rig(kind, programs=programs)
        put_odom(faulty, 5)
        change(faulty, 6, standoff_m="2")
        put_odom(faulty, 6)
        faulty.bus.call(PLACE, m.OdometryRequest())
        faulty.driver.host.close()

    line = error_of(NodeError, lambda: run(follower="my.py:Faulty"))
    assert re.fullmatch(r"follower: ZeroDivisionError: by zero \(.*test_host.py:\d+ fail\)", line)
    with pytest.raises(ZeroDivisionError):  # an error in an installed node has its traceback
        run()


@pytest.mark.parametrize(
    ("outputs", "line"),
    [
        ("stop", "follower: step must return a mapping of topics to messages, got str"),
        ({keys.FOLLOWER_STATE: m.FollowerState()}, "follower gives follower/state, which is not"),
        ({"cmd_vel": m.Twist()}, "follower: step returns 'cmd_vel', which is no topic"),
        ({CMD_VEL: m.Odometry()}, "follower: step returns cmd_vel as Odometry; it must be Twist"),
        (
            {CMD_VEL: m.Twist.planar(Twist2D(x=math.nan))},
            "follower gives cmd_vel: not a geometry_msgs/msg/Twist: Expected `float`, got `null`",
        ),
    ],
)
def test_a_wrong_output_of_a_user_node_is_refused(rig, outputs, line):
    kind = type("Wrong", (Follower,), {"step": lambda *_: outputs})
    wrong = rig(kind, programs={"follower": "my.py:Wrong"})
    assert error_of(NodeError, lambda: put_odom(wrong, 5)).startswith(line)


def test_a_part_belongs_to_a_robot_unless_all_robots_share_it():
    scenario = load_scenario(SCENARIOS / "convoy.toml")
    assert part_of("physics", scenario, "") is scenario
    assert part_of("target", scenario, "two") == scenario.of("two")
    with pytest.raises(ConfigError, match=r"^target: of which robot. --robot takes one or two$"):
        part_of("target", scenario, "")
    with pytest.raises(ConfigError, match=r"^--robot one: there is one physics for all robots$"):
        part_of("physics", scenario, "one")


class Viewer(Watcher):
    TOPICS = (CMD_VEL, JOINT_STATES, CLOCK)


@pytest.fixture
def viewer(bus, scenario):
    return Viewer(bus, scenario)


def at(tick, run=1, seed=9):
    return Stamp(tick * 10_000_000, run, seed)


def test_neither_ended_runs_nor_open_topics_begin_a_run(viewer, bus, put):
    for run in (1, 2, 3):
        put(CLOCK, m.Clock(), at(2, run=run, seed=run))
    # a new run resets before its first sample
    assert viewer.events[-2:] == [3, (m.Clock(), at(2, run=3, seed=3))]
    viewer.events.clear()
    for run in (0, 1, 2):
        put(JOINT_STATES, m.JointState(), at(100, run=run))
    for run in (0, 1, 2, 3, 4):
        put(CMD_VEL, forward(0.2), at(3, run=run))
    bus.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    put(JOINT_STATES, m.JointState(), at(1, run=3))
    late = (m.JointState(), at(1, run=3))
    assert viewer.events == [(forward(0.2), at(3, run=3)), (forward(0.3), None), late]
    assert viewer.stamp == at(2, run=3, seed=3)
    bus.stop()
    with pytest.raises(StoppedError):
        viewer.run()


@pytest.mark.usefixtures("viewer")
def test_rates_and_ages_of_inputs_are_reported(bus, put):
    reports = []

    def on_report(array, stamp):
        (status,) = array.status
        assert (status.name, array.header.stamp) == ("toy", stamp.time)
        reports.append({pair.key: pair.value for pair in status.values})

    bus.subscribe(diagnostics("toy"), on_report)
    for tick in range(301):
        put(CLOCK, m.Clock(), at(tick))
        if 100 <= tick < 200 and tick % 4 == 0:
            put(CMD_VEL, forward(0.1), at(tick))
        if tick == 250:
            bus.put_bytes("cmd_vel", b"{}")  # is as old as the tick in which it came
    columns = {key: [values.get(key) for values in reports] for key in reports[-1]}
    assert columns["hz/clock"] == [None, "100.0", "100.0", "100.0"]
    assert columns["hz/cmd_vel"] == [None, "0.0", "25.0", "1.0"]
    assert columns["age_s/cmd_vel"] == [None, "never", "0.04", "0.5"]
    for tick in range(101):  # a new run begins with inputs that never came
        put(CLOCK, m.Clock(), at(tick, run=2))
    assert (reports[-1]["hz/cmd_vel"], reports[-1]["age_s/cmd_vel"]) == ("0.0", "never")
