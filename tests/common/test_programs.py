"""How classes are found: installed ones, and those of one's own in a scenario."""

import os
import re
from pathlib import Path

import msgspec
import pytest
from harness import SCENARIOS, error_of
from mecazen import keys, programs
from mecazen.config import FollowerConfig, RobotConfig, Scenario, SensorConfig, SimConfig
from mecazen.errors import ConfigError
from mecazen.graph import NODES
from mecazen.keys import FOLLOWER_STATE, ODOM, TARGET_ODOM, Topic
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import String
from mecazen.node import Node, Row
from mecazen.programs import classes, find, graph_of
from mecazen.row import due, every, latest

NODE = """
from mecazen.config import FollowerConfig
from mecazen.row import Row, every, latest
from mecazen.keys import CLOCK, CMD_VEL, ODOM, TARGET_CMD_VEL
from mecazen.node import Node
from mecazen.schema import Positive, Section


class Settings(Section):
    gain: Positive = 1.0


class Mine(Node):
    ROW = Row("mine", inputs=(every(CLOCK), latest(ODOM)), outputs=(TARGET_CMD_VEL,))
    SECTION = Settings


class Leader(Node):
    ROW = Row("leader", inputs=(every(ODOM),), outputs=(CMD_VEL,))


class More(FollowerConfig):
    gain: Positive = 1.0


class Gainer(Leader):
    SECTION = More


class Nowhere(Node):
    pass


class Untyped(Mine):
    SECTION = int


NOT_A_CLASS = 3
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """One's own programs, in the folder where the process is started."""
    (tmp_path / "my.py").write_text(NODE)
    (tmp_path / "wrong.py").write_text("class Toy(")
    (tmp_path / "needs.py").write_text("import not_there")
    (tmp_path / "fails.py").write_text("1 / 0")
    (tmp_path / "folder.py").mkdir()
    monkeypatch.chdir(tmp_path)


def test_an_unknown_node_is_refused_with_the_names_of_all_nodes():
    text = error_of(ConfigError, lambda: find("physic", {}))
    nodes = ", ".join(sorted(row.name for row in NODES.values() if row.program))
    assert text == f"physic: no such node; nodes: {nodes}; or file.py:Class of your own"


def test_a_node_without_its_extra_is_refused_with_the_extra(monkeypatch):
    monkeypatch.setattr(programs, "is_installed", lambda extra: extra != "sensors")
    text = error_of(ConfigError, lambda: find("lidar", {}))
    assert text == "lidar is not installed: pip install 'mecazen[sensors]'"


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("none.py:Toy", "none.py: can't be imported: .*No such file"),
        ("wrong.py:Toy", r"wrong.py: can't be imported: .*\(wrong.py, line 1\)"),
        ("needs.py:Toy", "needs.py: can't be imported: No module named 'not_there'"),
        (
            "fails.py:Toy",
            r"fails.py: can't be imported: ZeroDivisionError: .*\(fails.py:1 <module>",
        ),
        ("folder.py:Toy", "folder.py: can't be imported: "),
        ("my.py:None", "my.py:None: no such class in my.py"),
        ("my.py:NOT_A_CLASS", "my.py:NOT_A_CLASS: not a subclass of mecazen.node.Node"),
        ("my.py:", "my.py:: no such class in my.py"),
        ("my.py:nowere", r"my.py:nowere: no such class in my.py; did you mean Nowhere\?"),
        ("my.py", "my.py: add the class, such as my.py:MyFollower"),
        ("my.py:Untyped", "my.py:Untyped: SECTION must be a subclass of mecazen.schema.Section"),
        ("not_there:Toy", "not_there: can't be imported: No module named 'not_there'"),
        ("json:JSONDecoder", "json:JSONDecoder: not a subclass of mecazen.node.Node"),
        (":Toy", "'': neither file.py nor a module's name"),
        ("..toy:Toy", "..toy: neither file.py nor a module's name"),
    ],
)
def test_when_a_class_of_ones_own_is_none_expect_one_line(program, expected):
    for name, own in ((program, {}), ("follower", {"follower": program})):
        text = error_of(ConfigError, lambda name=name, own=own: find(name, own))
        assert re.match(expected, text)


def test_a_program_that_is_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.py")
    said = error_of(ConfigError, lambda: find("toy", {"toy": f"{tmp_path}/pipe.py:Toy"}))
    assert said.endswith("pipe.py: must be a regular file, not a device or a pipe")


def test_a_class_of_ones_own_is_found_beside_the_scenario_and_takes_a_nodes_place(
    write_scenario, tmp_path, monkeypatch
):
    path = write_scenario("[programs]\nfollower = '../my.py:Leader'\n")
    monkeypatch.chdir(tmp_path / "robots")
    scenario = load_scenario(path)
    leader = find("follower", scenario.programs)
    assert leader.__name__ == find(f"{tmp_path / 'my.py'}:Leader", {}).__name__ == "Leader"
    assert graph_of(scenario).row("follower").inputs == leader.ROW.inputs
    # where its file can't be imported, as in a container of another service, the table counts
    scenario.programs["follower"] = str(tmp_path / "elsewhere.py:Leader")
    assert graph_of(scenario).row("follower").inputs != leader.ROW.inputs
    assert graph_of(scenario, {"follower": leader}).row("follower").inputs == (every(ODOM),)


def test_a_program_that_the_table_does_not_know_takes_part_with_a_strict_section(write_scenario):
    programs_table = "[programs]\nmine = '../my.py:Mine'\n"
    scenario = load_scenario(write_scenario(f"{programs_table}[mine]\ngain = 2.0\n"))
    assert scenario.services == (*Scenario.__struct_defaults__[0], "mine")
    assert scenario.parts[-1] == ("mine", "")
    assert scenario.mine.gain == 2.0
    assert graph_of(scenario).row("mine").part_of == "mine"
    for wrong, expected in {
        "gain = 0": "mine.gain: got 0; allowed: a number > 0",
        "gian = 2.0": "mine.gian: unknown key; did you mean gain",
    }.items():
        path = write_scenario(f"{programs_table}[mine]\n{wrong}\n")
        with pytest.raises(ConfigError, match=f"^{path}.*{expected}"):
            load_scenario(path)


def test_a_class_in_a_nodes_place_may_add_settings_to_its_section(write_scenario, tmp_path):
    added = "[follower]\nstandoff_m = 2.0\ngain = 3.0\n"
    follower = load_scenario(
        write_scenario(f"[programs]\nfollower = '../my.py:Gainer'\n{added}")
    ).follower
    assert (follower.standoff_m, follower.gain) == (2.0, 3.0)
    with pytest.raises(ConfigError, match=r"must be a subclass of .*FollowerConfig$"):
        load_scenario(write_scenario("[programs]\nfollower = '../my.py:Mine'\n"))
    # where the file is not, as in a container of another service, only it could read the section
    elsewhere = "follower = 'elsewhere.py:Gainer'\nodometry = 'elsewhere.py:Gainer'\n"
    path = write_scenario(f"[programs]\n{elsewhere}{added}[odometry]\ngain = 3.0\n")
    assert load_scenario(path).follower == FollowerConfig()


def test_a_user_node_with_a_section_has_a_name_that_python_can_say(write_scenario):
    path = write_scenario("[programs]\nmy-node = '../my.py:Mine'\n")
    expected = "^programs: 'my-node' has a section, so its name must be letters, digits and _$"
    with pytest.raises(ConfigError, match=expected):
        load_scenario(path)


def test_a_user_node_whose_section_has_no_defaults_needs_one(write_scenario, tmp_path):
    (tmp_path / "my.py").write_text(NODE.replace("Positive = 1.0", "Positive", 1))
    with pytest.raises(ConfigError, match=r"mine: missing$"):
        load_scenario(write_scenario("[programs]\nmine = '../my.py:Mine'\n"))


def test_where_services_name_it_a_program_takes_part_once(write_scenario):
    path = write_scenario("services = ['mine', 'physics']\n[programs]\nmine = '../my.py:Mine'\n")
    assert load_scenario(path).services == ("mine", "physics")


@pytest.mark.parametrize("name", ["clock", "collector", "router", "sim", "a/b", "a+b", "é", ""])
def test_a_name_that_means_something_else_is_no_nodes(write_scenario, name):
    with pytest.raises(ConfigError, match=re.escape(f"programs: {name!r} can't be")):
        load_scenario(
            write_scenario(), parse_settings((f'programs={{"{name}"="{Path.cwd()}/my.py:Mine"}}',))
        )


def test_a_class_without_a_row_has_that_of_the_node_that_it_replaces_and_no_place_of_its_own(
    write_scenario,
):
    scenario = load_scenario(write_scenario("programs.follower = '../my.py:Nowhere'\n"))
    assert graph_of(scenario).row("follower").outputs == (FOLLOWER_STATE, keys.CMD_VEL)
    with pytest.raises(ConfigError, match=r"my.py:Nowhere: needs ROW, its row of the graph"):
        load_scenario(write_scenario("[programs]\nnowhere = '../my.py:Nowhere'\n"))


@pytest.mark.parametrize(
    ("place", "outputs", "missing"),
    [
        ("follower", (FOLLOWER_STATE,), "cmd_vel, which controller"),
        ("controller", (), "joint_command, which physics"),
        ("target", (TARGET_ODOM,), "target/observation, which follower"),
    ],
)
def test_what_takes_a_place_must_give_what_others_wait_for(scenario, place, outputs, missing):
    class Mine(Node):
        ROW = Row(place, outputs=outputs)

        def reset(self, seed): ...

        def step(self, tick, inputs):
            return {}

    expected = f"{place}: in the place of {place} it must give {missing} waits for"
    with pytest.raises(ConfigError, match=f"^{re.escape(expected)}$"):
        graph_of(scenario, {place: Mine})


@pytest.mark.parametrize(
    ("place", "program", "wanted"),
    [
        ("viewer", "Leader", "Observer"),
    ],
)
def test_what_takes_a_place_is_of_its_kind(write_scenario, place, program, wanted):
    scenario = load_scenario(write_scenario(f"programs.{place} = '../my.py:{program}'\n"))
    expected = rf"my.py:{program}: in the place of {place} there is a {wanted}$"
    with pytest.raises(ConfigError, match=expected):
        classes(place, scenario)


OWN = every(keys.CLOCK)
LOOP = Topic("loop", String, "what closes a circle")


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (Row("mine", inputs=(OWN,), outputs=(Topic("a//b", String, ""),)), "'a//b' is no key: "),
        (Row("mine", inputs=(OWN,), outputs=(Topic("a*", String, ""),)), r"'a\*' is no key: "),
        (Row("mine", inputs=(every(Topic("odom", String, "")),)), "odom is a key of mecazen's own"),
        (Row("mine", inputs=(latest(ODOM),), outputs=(LOOP,)), "no input of rule `every`"),
        (Row("mine", inputs=(every(LOOP),)), "mine needs loop, which no node here gives"),
    ],
)
def test_a_row_that_can_not_work_in_its_graph_is_refused(scenario, row, expected):
    with pytest.raises(ConfigError, match=f"^mine.py:Mine: {expected}"):
        graph_with(scenario, mine=row)


def test_a_node_without_the_node_that_it_waits_for_is_refused(scenario):
    lacking = msgspec.structs.replace(scenario, services=("physics", "target", "follower"))
    with pytest.raises(ConfigError, match=r"^services: follower needs odom, which no node"):
        graph_of(lacking)


def test_a_query_is_answered_by_one_node(scenario):
    with pytest.raises(ConfigError, match=r"^odometry and mine both give set_odometry$"):
        graph_with(scenario, mine=Row("mine", inputs=(OWN,), calls=(keys.SET_ODOMETRY,)))


@pytest.mark.parametrize(("rule", "mode"), [(due, "real_time"), (latest, "lockstep")])
def test_nodes_that_would_wait_for_each_other_are_refused(scenario, rule, mode):
    scenario = msgspec.structs.replace(scenario, sim=SimConfig(mode=mode))
    mine = Row("mine", inputs=(every(FOLLOWER_STATE),), outputs=(LOOP,))
    loop = Row("follower", inputs=(every(ODOM), rule(LOOP)), outputs=NODES["follower"].outputs)
    with pytest.raises(
        ConfigError, match=r"(mine waits for follower|follower waits for mine) waits"
    ):
        graph_with(scenario, mine=mine, follower=loop)


def test_a_controller_of_ones_own_does_not_bypass_the_guard():
    class Wheels(Node):
        ROW = Row("controller", inputs=(due(keys.CMD_VEL),), outputs=(keys.JOINT_COMMAND,))

        def reset(self, seed): ...

        def step(self, tick, inputs):
            return {}

    guarded = load_scenario(SCENARIOS / "teleop.toml")
    with pytest.raises(ConfigError, match="takes guard/cmd_vel, not cmd_vel"):
        graph_of(guarded, {"controller": Wheels})
    graph_of(load_scenario(SCENARIOS / "teleop.toml", {"guard.enabled": False}))


def test_a_robot_has_no_name_that_begins_a_key_of_ones_own(scenario):
    robots = (RobotConfig(name="loop"),)
    with pytest.raises(ConfigError, match=r"^robots: the name 'loop' begins a key of a node"):
        graph_with(
            msgspec.structs.replace(scenario, robots=robots),
            mine=Row("mine", inputs=(OWN,), outputs=(LOOP,)),
        )


def graph_with(scenario, **rows):
    """Return the graph of a scenario with nodes of one's own, each with its row."""

    def kind(row):
        members = {"ROW": row, "reset": lambda *_: None, "step": lambda *_: {}}
        return type(row.name, (Node,), members)

    own = {name: f"{name}.py:{name.title()}" for name in rows}
    services = dict.fromkeys((*scenario.services, *rows))
    scenario = msgspec.structs.replace(scenario, programs=own, services=tuple(services))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(programs, "find", lambda name, _: kind(rows[name]))
        return graph_of(scenario)


def names(scenario: Scenario) -> set[str]:
    return {row.name for row in graph_of(scenario).rows}


@pytest.mark.parametrize(
    ("sensor", "more", "giver"),
    [
        ({}, set(), "target"),
        ({"kind": "body"}, {"tracker", "body"}, "body"),
        ({"kind": "legs"}, {"lidar", "legs", "guard"}, None),
        ({"kind": "fused"}, {"tracker", "body", "lidar", "legs", "guard"}, "body"),
        ({"also": ("lidar", "depth")}, {"lidar", "depth", "guard"}, "target"),
    ],
    ids=["pose", "body", "legs", "fused", "pose, and two to look at"],
)
def test_nodes_take_part_with_the_kind_of_sensor_that_needs_them(
    write_scenario, sensor, more, giver
):
    text = "".join(
        f"sensor.{key} = {list(v) if key == 'also' else repr(v)}\n" for key, v in sensor.items()
    )
    scenario = load_scenario(write_scenario(text))
    assert scenario.sensor == SensorConfig(**sensor)
    graph = graph_of(scenario)
    assert names(scenario) - names(load_scenario(write_scenario(""))) == more
    row = graph.giver(keys.OBSERVATION.key)
    assert (row and row.name) == giver
    assert (graph.giver(keys.TARGET_SKELETON.key) is not None) == bool(more)


def test_a_service_without_a_part_in_the_scenario_is_refused(write_scenario):
    path = write_scenario("services = ['physics', 'controller', 'target', 'sensors']\n")
    with pytest.raises(ConfigError, match="sensors takes no part with"):
        graph_of(load_scenario(path))


def test_the_rate_of_a_sensor_is_known_where_its_service_is_not_installed(write_scenario):
    scenario = load_scenario(write_scenario("sensor.kind = 'fused'\n"))
    assert scenario.ticks_per(graph_of(scenario).rate(keys.LEGS.key)) == 10
    assert scenario.ticks_per(graph_of(scenario).rate(keys.OBSERVATION.key)) == 4
