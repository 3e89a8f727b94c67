"""The graph of a scenario: its nodes, the classes of users, and the rows that it refuses."""

import re
import shutil
from collections import Counter

import msgspec
import pytest
import toys
from harness import SCENARIOS, error_of
from mecazen import keys, programs
from mecazen.config import FollowerConfig, RobotConfig, Scenario
from mecazen.errors import ConfigError
from mecazen.graph import GRAPH, Graph
from mecazen.keys import CLOCK, CMD_VEL, FOLLOWER_STATE, JOINT_COMMAND, ODOM, Topic
from mecazen.loading import load_scenario
from mecazen.messages import String
from mecazen.programs import find, graph_of, refuse_missing
from mecazen.row import Row, due, every, latest

GRAPH_OF_ALL = Graph(GRAPH)
LOOP = Topic("loop", String, "")


@pytest.fixture
def folder(tmp_path):
    """The folder of a user's programs, above that of the scenario."""
    shutil.copy(toys.__file__, tmp_path / "my.py")
    return tmp_path


def test_a_node_without_its_extra_is_refused_with_the_extra(monkeypatch):
    monkeypatch.setattr(programs, "is_installed", lambda extra: extra != "sensors")
    text = error_of(ConfigError, lambda: find("lidar", {}))
    assert text == "lidar is not installed: pip install 'mecazen[sensors]'"


def row(name, *inputs, gives=(), **more):
    """Return a row, with a step for each tick if no inputs are named."""
    return Row(name, inputs=inputs or (every(CLOCK),), outputs=tuple(gives), **more)


def topic(key):
    return Topic(key, String, "")


def graph_with(scenario, *more, **changes):
    """Return the graph of a scenario with the nodes of a user, by their rows."""
    with toys.user_nodes(*more) as user_programs:
        services = tuple(dict.fromkeys((*scenario.services, *user_programs)))
        changes |= {"programs": user_programs, "services": services}
        return graph_of(msgspec.structs.replace(scenario, **changes))


@pytest.mark.parametrize(
    ("line", "make"),
    [
        (
            "user:follower: in the place of follower it must give cmd_vel, which controller waits",
            lambda: row("follower", gives=[FOLLOWER_STATE]),
        ),
        ("user:mine: 'a//b' is no key: ", lambda: row("mine", gives=[topic("a//b")])),
        ("user:mine: odom is a key of mecazen's own", lambda: row("mine", every(topic("odom")))),
        ("user:mine: no input of rule `every`", lambda: row("mine", latest(ODOM), gives=[LOOP])),
        ("user:mine: mine needs loop, which no node here gives", lambda: row("mine", every(LOOP))),
        ("odometry and mine both give set_odo", lambda: row("mine", calls=(keys.SET_ODOMETRY,))),
        ("row a: outputs: each topic at most once", lambda: row("a", gives=(ODOM, ODOM))),
        ("row a: rates: 'odom' is no key of its outputs", lambda: row("a", rates={"odom": 1.0})),
        (
            "row a: rates: odom must be pos",
            lambda: row("a", gives=[ODOM], rates={"odom": 0.0}),
        ),
    ],
)
def test_a_wrong_row_is_one_line(scenario, line, make):
    assert re.match(line, error_of(ConfigError, lambda: graph_with(scenario, make())))


def test_a_user_node_bypasses_no_guard_and_names_no_robot(scenario):
    wheels = row("controller", every(keys.JOINT_STATES), due(CMD_VEL), gives=[JOINT_COMMAND])
    with pytest.raises(ConfigError, match="takes guard/cmd_vel, not cmd_vel"):
        graph_with(load_scenario(SCENARIOS / "teleop.toml"), wheels)
    graph_with(load_scenario(SCENARIOS / "teleop.toml", {"guard.enabled": False}), wheels)
    with pytest.raises(ConfigError, match=r"^robots: the name 'loop' begins a key of a node"):
        graph_with(scenario, row("mine", gives=[LOOP]), robots=(RobotConfig(name="loop"),))


def test_a_user_class_takes_the_place_of_a_node(write_scenario, folder, monkeypatch):
    path = write_scenario("[programs]\nfollower = '../my.py:Leader'\n")
    monkeypatch.chdir(folder / "robots")
    scenario = load_scenario(path)
    leader = find("follower", scenario.programs)
    assert leader.__name__ == find(f"{folder / 'my.py'}:Leader", {}).__name__ == "Leader"
    assert graph_of(scenario).row("follower").inputs == leader.ROW.inputs
    # a container of another service lacks the file: there the row of the table applies
    scenario.programs["follower"] = str(folder / "elsewhere.py:Leader")
    assert graph_of(scenario).row("follower").inputs != leader.ROW.inputs
    assert graph_of(scenario, {"follower": leader}).row("follower").inputs == (every(ODOM),)
    with pytest.raises(ConfigError, match=r"elsewhere.py: can't be imported"):
        refuse_missing("follower", scenario)
    refuse_missing("controller", scenario)
    scenario.programs["follower"] = str(folder / "my.py:Toy")  # without a row
    assert graph_of(scenario).row("follower").outputs == (FOLLOWER_STATE, CMD_VEL)


@pytest.mark.usefixtures("folder")
def test_a_user_node_takes_part_with_its_section(write_scenario):
    program = "programs.mine = '../my.py:Mine'\n"
    scenario = load_scenario(write_scenario(f"{program}mine.gain = 2.0\n"))
    assert scenario.services == (*Scenario.__struct_defaults__[0], "mine")
    assert scenario.parts[-1] == ("mine", "")
    assert scenario.mine.gain == 2.0
    assert graph_of(scenario).row("mine").part_of == "mine"
    named = load_scenario(write_scenario(f"services = ['mine', 'physics']\n{program}"))
    assert named.services == ("mine", "physics")


@pytest.mark.usefixtures("folder")
def test_a_class_in_a_nodes_place_may_extend_its_section(write_scenario):
    text = "[follower]\nstandoff_m = 2.0\ngain = 3.0\n"
    path = write_scenario(f"programs.follower = '../my.py:Gainer'\n{text}")
    follower = load_scenario(path).follower
    assert (follower.standoff_m, follower.gain) == (2.0, 3.0)
    # a container of another service lacks the file, which alone can read the section
    programs = "follower = 'elsewhere.py:Gainer'\nodometry = 'elsewhere.py:Gainer'\n"
    path = write_scenario(f"[programs]\n{programs}{text}[odometry]\ngain = 3.0\n")
    assert load_scenario(path).follower == FollowerConfig()


@pytest.mark.parametrize(
    ("sensor", "more", "giver"),
    [
        ({}, set(), "target"),
        ({"kind": "legs"}, {"lidar", "legs", "guard"}, None),
        ({"kind": "fused"}, {"tracker", "body", "lidar", "legs", "guard"}, "body"),
        ({"also": ("lidar", "depth")}, {"lidar", "depth", "guard"}, "target"),
    ],
)
def test_nodes_take_part_with_the_sensor_that_needs_them(write_scenario, sensor, more, giver):
    lines = msgspec.toml.encode({"sensor": sensor}).decode()
    plain, graph = (graph_of(load_scenario(write_scenario(text))) for text in ("", lines))
    assert {row.name for row in graph.rows} - {row.name for row in plain.rows} == more
    row = graph.giver(keys.OBSERVATION.key)
    assert (row and row.name) == giver
    assert (graph.giver(keys.TARGET_SKELETON.key) is not None) == bool(more)


def test_every_topic_and_call_is_in_the_table_once():
    names = [topic.key for topic in keys.TOPICS] + [call.key for call in keys.CALLS]
    assert len(set(names)) == len(names)
    for topic in keys.TOPICS:
        assert keys.resolve(f"two/{topic.key}", keys.TOPICS) == ("two", topic)
    assert keys.topic_of(keys.diagnostics("physics").key) is keys.DIAGNOSTICS
    assert keys.topic_of("cmd_vel/more") is None


def test_every_topic_and_call_has_one_giver_or_is_open():
    inputs = {i.topic for row in GRAPH for i in row.inputs} - {keys.DIAGNOSTICS}
    assert [t.key for t in inputs if not (t.open or GRAPH_OF_ALL.giver(t.key))] == []
    outputs = {topic for row in GRAPH for topic in row.outputs}
    from_outside = {keys.EMERGENCY_STOP, keys.TARGET_CMD_VEL, keys.DIAGNOSTICS}
    assert set(keys.TOPICS) - outputs == from_outside
    for world in ("physics", "hardware"):  # a scenario has one of them
        nodes = [row for row in GRAPH if row.part_of != world]
        answered = Counter(call for row in nodes for call in row.calls)
        assert set(answered.values()) == {1}
        assert set(keys.CALLS) - set(answered) <= {keys.STOP_MOTORS, keys.RELEASE_MOTORS}


def test_a_topic_has_the_rate_of_its_row_or_of_its_givers_inputs(write_scenario):
    topics = (keys.JOINT_STATES, JOINT_COMMAND, keys.TARGET_CMD_VEL, CMD_VEL, keys.OBSERVATION)
    rates = [GRAPH_OF_ALL.rate(topic.key) for topic in topics]
    assert rates == [None, None, None, "controller.update_rate_hz", "sensor.rate_hz"]
    fused = load_scenario(write_scenario("sensor.kind = 'fused'\n"))
    ticks = [fused.ticks_per(graph_of(fused).rate(topic.key)) for topic in (keys.LEGS, topics[-1])]
    assert ticks == [10, 4]
    first = row("first", every(ODOM), gives=[CMD_VEL])
    for rates, rate in (({}, None), ({ODOM.key: 20.0}, 20.0)):  # of a circle
        second = row("second", every(CMD_VEL), gives=[ODOM], rates=rates)
        assert Graph((first, second)).rate(CMD_VEL.key) == rate
