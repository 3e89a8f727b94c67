"""A scenario is checked whole, and what is wrong with it is one line that says where."""

import math
from pathlib import Path

import msgspec
import pytest
import tomli_w
from harness import ROOT, SCENARIOS, error_of
from mecazen.config import BusConfig, Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import effective, load_scenario, scenario_path
from mecazen.robot import Payload
from mecazen.schema import Folder
from mecazen.ticks import whole_ticks

TOY = """
from typing import Annotated

import msgspec
from mecazen.keys import ODOM
from mecazen.node import Node, Row, every
from mecazen.schema import Section


class Slow(Section, tag="slow", tag_field="kind"):
    speed_m_s: float = 0.1


class Fast(Section, tag="fast", tag_field="kind"):
    speed_m_s: Annotated[float, msgspec.Meta(gt=0.0)]


class Toy(Section):
    walk: Slow | Fast = Slow()
    weights: dict[str, float] = msgspec.field(default_factory=dict)
    limit: Annotated[float, msgspec.Meta(gt=0.0)] | None = None
    mixed: float | str = 0.0


class ToyNode(Node):
    ROW = Row("toy", inputs=(every(ODOM),))
    SECTION = Toy
"""
"""A user node whose section has one of everything."""
FAST = "[toy.walk]\nkind = 'fast'\n"


def problem(path: Path, *overrides: str) -> str:
    """Return the error of a scenario, as one line without the test's folder."""
    text = error_of(ConfigError, lambda: load_scenario(path, overrides))
    return text.replace(f"{path.parents[1]}/", "")


NUMBER_OF_TICKS = "a number >= 0.001 and <= 1"
FILE = "file; allowed: a path to a file"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("seeed = 1", "seeed: unknown key; did you mean seed? allowed: "),
        ("[sim]\ntik_s = 1.0", "sim.tik_s: unknown key; did you mean tick_s? allowed: "),
        ("[foo]\nx = 1", "foo: unknown key; allowed: bus, "),
        ("robot_name = 'a'", "unknown key 'robot_name'"),
        ("others = {}", "unknown key 'others'"),
        ('[sim]\n"two\\nlines" = 1', r"sim.two\nlines: unknown key; allowed: "),
        ("[sim]\ntick_s = 'fast'", f"sim.tick_s: got 'fast'; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = true", f"sim.tick_s: got true; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = 5.0", f"sim.tick_s: got 5.0; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = nan", f"sim.tick_s: got nan; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = 2020-01-01", f"sim.tick_s: got 2020-01-01; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = 0.0100000001234", "sim.tick_s = 0.0100000001234 must be whole nanosec"),
        ("[sim]\nduration_s = 0.001", "sim.duration_s = 0.001 must be at least a tick"),
        ("[sim]\nmode = 'fast'", "sim.mode: got 'fast'; allowed: 'lockstep' or 'real_time'"),
        ("[sim]\nmode = 1", "sim.mode: got 1; allowed: 'lockstep' or 'real_time'"),
        ("sim = 3", "sim: got 3; allowed: a table"),
        ("seed = -1", "seed: got -1; allowed: a whole number >= 0 and <= 4294967295"),
        ("seed = 1.5", "seed: got 1.5; allowed: a whole number "),
        (f"seed = {'9' * 300}", "seed: got a number of too many digits; allowed: "),
        ("services = 'physics'", "services: got 'physics'; allowed: a list, each a string"),
        ("services = ['physics', 3]", "services.1: got 3; allowed: a string"),
        ("services = ['physics', 'physics']", "services: each at most once"),
        ("[programs]\nfollower = 3", "programs.follower: got 3; allowed: a string"),
        ("programs = ['x']", "programs: got ['x']; allowed: a table, each value a string"),
        ("[bus]\nconnect = 'tcp/127.0.0.1:1'", "bus.connect: got 'tcp/127.0.0.1:1'; allowed: a li"),
        ("[bus]\nnamespace = '/robot'", "bus.namespace: got '/robot'; allowed: a string that mat"),
        ("[bus]\nnamespace = 5", "bus.namespace: got 5; allowed: a string that matches "),
        ("[bus]\nmulticast_scouting = 'yes'", "bus.multicast_scouting: got 'yes'; allowed: true o"),
        ("[bus]\nformat = 'cdr'", "bus.format: got 'cdr'; allowed: 'json' or 'msgpack'"),
        ("[bus]\nzenoh_config = 3", "bus.zenoh_config: got 3; allowed: a path to a file"),
        ("[bus]\nzenoh_config = 'x'", f"bus.zenoh_config: scenarios/x: no such {FILE}"),
        ("[bus]\nkeys = 'x'", f"bus.keys: scenarios/x: no such {FILE.replace('file', 'folder')}"),
        ("[sensor]\noccluded = 1", "sensor.occluded: unknown key; "),
        (
            "[sensor]\nocclusions_s = [[1, 2], [3, 'x']]",
            "sensor.occlusions_s.1.1: got 'x'; allowed: ",
        ),
        ("[sensor]\nocclusions_s = [[1.0]]", "sensor.occlusions_s.0: got [1.0]; allowed: [a numb"),
        ("[sensor]\nocclusions_s = [[2.0, 1.0]]", "sensor: occlusions_s: [2.0, 1.0] must end aft"),
        ("seed = 1\nseed = 2", "not TOML: "),
        ("seed = ", "not TOML: "),
        (f"seed = {'9' * 5000}", "not TOML: "),
        (f"seed = {'[' * 5000}", "not TOML: "),
    ],
)
def test_when_a_value_is_wrong_expect_file_key_and_what_is_allowed(write_scenario, text, expected):
    assert problem(write_scenario(text)).startswith(f"scenarios/test.toml: {expected}")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("seeed=1", "seeed: unknown key; did you mean seed? "),
        ("sim.tick_s=5", f"sim.tick_s: got 5; allowed: {NUMBER_OF_TICKS}"),
        ("sim.mode=fast", "sim.mode: got 'fast'; allowed: 'lockstep' or 'real_time'"),
        ("seed=", "seed: got ''; allowed: "),
        ("seed=[1,", "seed: got '[1,'; allowed: "),
        ("seed=1\nsim.speed=2", r"seed: got '1\nsim.speed=2'; allowed: "),
        (f"seed={'9' * 5000}", "seed: got '999999"),
        (f"seed={'[' * 5000}", "seed: got '[[[[["),
        ("sim=3", "sim: got 3; allowed: a table"),
        ("sim.mode.x=3", "sim.mode.x: sim.mode: got a table; allowed: 'lockstep' or 'real_time'"),
        ("services=physics", "services: got 'physics'; allowed: a list, each a string"),
        ('services=["a",3]', "services: services.1: got 3; allowed: a string"),
        ('services=["a","a"]', "services: services: each at most once"),
        ("programs.follower=3", "programs.follower: got 3; allowed: a string"),
        ("sensor.occlusions_s=[[2.0,1.0]]", "sensor.occlusions_s: sensor: occlusions_s: [2.0, 1.0"),
        ("sim.tick_s=0.0100000001234", "sim.tick_s: sim.tick_s = 0.0100000001234 must be whole"),
    ],
)
def test_when_an_override_is_wrong_expect_the_override_named(write_scenario, override, expected):
    start = f"scenarios/test.toml with --set {expected}"
    assert problem(write_scenario(), override).startswith(start)


@pytest.mark.parametrize("override", ["seed", "=3", "a b=3", ".seed=1", "seed.=1", "", "a\nb"])
def test_when_an_override_is_no_assignment_expect_its_form(write_scenario, override):
    text = problem(write_scenario(), override)
    assert text.startswith("--set ")
    assert text.endswith(": must be key.path=value")


def test_when_an_override_goes_into_a_value_expect_that_it_is_no_table(write_scenario):
    assert problem(write_scenario("seed = 1"), "seed.x=3") == "--set seed.x: seed is not a table"


def test_when_the_file_is_wrong_beside_an_override_expect_the_file_alone_named(write_scenario):
    path = write_scenario("[sim]\nmode = 1")
    assert problem(path, "sim.speed=2").startswith("scenarios/test.toml: sim.mode: ")
    path = write_scenario("[sensor]\nocclusions_s = [[2.0, 1.0]]")
    assert problem(path, "sensor.fov_deg=30").startswith("scenarios/test.toml: sensor: occl")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (
            "robot.wheels.raduis_m=1",
            "wheels.raduis_m: unknown key; did you mean radius_m? allowed: ",
        ),
        ("robot.wheels.radius_m=-1", "wheels.radius_m: got -1; allowed: a number > 0 "),
        (
            'robot.rollers.arrangement="O"',
            "rollers.arrangement: robot: rollers.arrangement = 'O': such a robot can hardly turn",
        ),
        (
            "robot.rollers.hull_spheres=10",
            "rollers.hull_spheres: robot: rollers.hull_spheres = 10 must be odd",
        ),
        ("robot.rollers.count=3", "rollers.count: got 3; allowed: a whole number >= 4 and <= 40"),
        ("robot.name=Foo", "name: got 'Foo'; allowed: a string that matches "),
        ("robot.camera={}", "camera: robot.camera.size_m: missing; must be a list, each a number"),
        ("robot.camera.position_m=[0.0,0.0]", "camera.position_m: got [0.0, 0.0]; allowed: [a num"),
        (
            "robot.wheels.radius_m=0.01",
            "wheels.radius_m: robot: rollers.max_radius_m = 0.0095 must be below half of "
            "wheels.radius_m = 0.01",
        ),
        ("robot.lidar.size_m=[1.0]", "lidar.size_m: robot: lidar.size_m must be [radius, height]"),
    ],
)
def test_when_an_override_breaks_the_robot_expect_the_robot_file_named(
    write_scenario, override, expected
):
    start = f"robots/nexus.toml with --set robot.{expected}"
    assert problem(write_scenario(), override).startswith(start)


def test_when_the_robot_file_is_wrong_expect_it_named(write_scenario):
    path = write_scenario()
    robot = path.parents[1] / "robots" / "nexus.toml"
    robot.write_text(robot.read_text().replace("count = 9", "count = 'nine'"))
    assert problem(path).startswith("robots/nexus.toml: robot.rollers.count: got 'nine'; allowed: ")
    robot.write_text("name = ")
    assert "nexus.toml: not TOML: " in problem(path)


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        ("", "scenarios/test.toml: robot: missing; must be a robot file, or a table"),
        ('robot = { file = "none.toml" }\n', "scenarios/none.toml: no such file"),
        (
            'robot = { file = "../robots/nexus.toml", payload = { mass_kg = 1.0 } }\n',
            "scenarios/test.toml: robot.payload.position_m: missing; must be [a number >= ",
        ),
        (
            'robot = { file = "../robots/nexus.toml", '
            "payload = { mass_kg = 1.0, position_m = [0.0, 0.0, 0.1] } }\n",
            "robots/nexus.toml: robot: payload.position_m: its underside would be 0 m above the ",
        ),
        ("robot = 5\n", "scenarios/test.toml: robot: got 5; allowed: a robot file, or a table"),
        ('[robot]\nname = "x"\n', "scenarios/test.toml: robot.base: missing; must be a table"),
        ('robot = "none.toml"\n', "scenarios/none.toml: no such file"),
        ('robot = "none"\n', "scenarios/test.toml: robot: none: no such robot; a path"),
        ('robot = "../robots"\n', "scenarios/../robots: can't be read: Is a directory"),
        ('robot = "a\\u0000b"\n', r"scenarios/a\x00b: can't be read: embedded null byte"),
    ],
)
def test_when_there_is_no_robot_expect_what_is_missing(write_scenario, robot, expected):
    assert problem(write_scenario(robot=robot)).startswith(expected)


def test_a_robot_and_a_world_that_come_with_the_package_go_by_their_names(write_scenario):
    path = f"{ROOT}/configs/worlds/ward.toml"
    by_path = load_scenario(write_scenario(f'world = "{path}"\n'))
    by_name = load_scenario(write_scenario('world = "ward"\n', robot='robot = "nexus"\n'))
    assert (by_name.robot, by_name.world) == (by_path.robot, by_path.world)


def test_a_scenario_changes_some_of_a_robot_file(write_scenario):
    payload = "payload = { mass_kg = 2.0, position_m = [0.0, 0.1, 0.3] }"
    path = write_scenario(robot=f'robot = {{ file = "../robots/nexus.toml", {payload} }}\n')
    robot = load_scenario(path).robot
    assert robot.payload == Payload(mass_kg=2.0, position_m=(0.0, 0.1, 0.3))
    assert load_scenario(path, ("robot.payload.mass_kg=3",)).robot.payload.mass_kg == 3.0
    assert msgspec.structs.replace(robot, payload=None) == load_scenario(write_scenario()).robot


def test_when_a_file_is_missing_expect_its_path(write_scenario):
    assert problem(write_scenario(), "robot=none.toml") == "scenarios/none.toml: no such file"
    path = write_scenario().with_name("none.toml")
    assert problem(path) == "scenarios/none.toml: no such file"
    path.write_bytes(b"\xff\xfe")
    assert problem(path).startswith("scenarios/none.toml: can't be read: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[toy]\nwolk = 1", "toy.wolk: unknown key; did you mean walk? allowed: limit, mixed, wal"),
        ("toy = 1", "toy: got 1; allowed: a table"),
        ("[toy.walk]\nkind = 'fst'", "toy.walk.kind: got 'fst'; allowed: 'slow' or 'fast'"),
        ("[toy.walk]\nspeed_m_s = 1.0", "toy.walk.kind: missing; must be 'slow' or 'fast'"),
        ("[toy]\nwalk = 3", "toy.walk: got 3; allowed: "),
        (FAST, "toy.walk.speed_m_s: missing; must be a number > 0"),
        (f"{FAST}speed_m_s = 0.0", "toy.walk.speed_m_s: got 0.0; allowed: a number > 0"),
        (
            f"{FAST}speed = 1.0",
            "toy.walk.speed: unknown key; did you mean speed_m_s? allowed: kind, sp",
        ),
        ("[toy.weights]\na = 1.0\nb = 'x'", "toy.weights.b: got 'x'; allowed: a number"),
        ("[toy]\nlimit = 0.0", "toy.limit: got 0.0; allowed: a number > 0"),
        ("[toy]\nlimit = 'none'", "toy.limit: got 'none'; allowed: a number > 0"),
        ("[toy]\nmixed = true", "toy.mixed: got true; allowed: a number or a string"),
    ],
)
def test_when_the_section_of_a_user_node_is_wrong_expect_the_same_care(
    write_scenario, tmp_path, text, expected
):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(f"programs.toy = '../toy.py:ToyNode'\n{text}")
    assert problem(path).startswith(f"scenarios/test.toml: {expected}")


@pytest.mark.parametrize(
    ("override", "read", "expected"),
    [
        ("sim.mode=lockstep", lambda s: s.sim.mode, "lockstep"),
        ('sim.mode="lockstep"', lambda s: s.sim.mode, "lockstep"),
        ("sim.speed=2", lambda s: s.sim.speed, 2.0),
        (" sim.speed = 2.5 ", lambda s: s.sim.speed, 2.5),
        ("bus.multicast_scouting=true", lambda s: s.bus.multicast_scouting, True),
        ('bus.connect=["tcp/127.0.0.1:1"]', lambda s: s.bus.connect, ("tcp/127.0.0.1:1",)),
        ("bus.namespace=robot_2", lambda s: s.bus.namespace, "robot_2"),
        ("sensor.occlusions_s=[[1, 2]]", lambda s: s.sensor.occlusions_s, ((1.0, 2.0),)),
        ("start={x_m=2.0}", lambda s: s.start.pose, Pose2D(2.0, 0.0, 0.0)),
        ("services=[]", lambda s: s.services, ()),
        ("robot.wheels.track_m=0.4", lambda s: s.robot.half_track, 0.2),
        ("robot=../robots/nexus.toml", lambda s: s.robot.name, "nexus"),
    ],
)
def test_an_override_is_taken_as_toml_and_a_bare_word_as_a_string(
    write_scenario, override, read, expected
):
    assert read(load_scenario(write_scenario(), (override,))) == expected


def test_the_last_of_two_overrides_of_a_key_counts(write_scenario):
    assert load_scenario(write_scenario("seed = 1"), ("seed=2", "seed=3")).seed == 3


def test_paths_are_relative_to_the_scenario_wherever_it_is_started(
    write_scenario, tmp_path, monkeypatch
):
    path = write_scenario(
        "[bus]\nzenoh_config = 'zenoh.json5'\n[programs]\nfollower = 'my.py:Mine'"
    )
    (path.parent / "zenoh.json5").write_text("{}")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    loaded = load_scenario(Path("..") / "scenarios" / "test.toml")
    assert loaded.bus.zenoh_config == path.parent / "zenoh.json5"
    assert loaded.programs == {"follower": f"{path.parent / 'my.py'}:Mine"}
    assert loaded.robot.name == "nexus"


def test_the_effective_configuration_loads_again_to_the_same(write_scenario, tmp_path):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(
        "seed = 7\n[programs]\nfollower = 'my.py:Mine'\ntoy = '../toy.py:ToyNode'\n"
        "[sim]\ntick_s = 0.02\n[sensor]\nocclusions_s = [[1.0, 2.5]]\n"
        "[bus]\nzenoh_config = 'zenoh.json5'\nnamespace = 'a/b'\n"
        "[toy.walk]\nkind = 'fast'\nspeed_m_s = 0.1\n[toy.weights]\na = 0.1\n"
    )
    (path.parent / "zenoh.json5").write_text("{}")
    loaded = load_scenario(path)
    again = tmp_path / "again.toml"
    again.write_text(tomli_w.dumps(effective(loaded)))
    assert load_scenario(again) == loaded


def test_the_effective_configuration_holds_every_default(scenario):
    tables = effective(scenario)
    expected = {"mode": "real_time", "tick_s": 0.01, "speed": 1.0, "duration_s": 60.0}
    assert tables["sim"] == {**expected, "answer_timeout_s": 10.0}
    assert "namespace" not in tables["bus"]
    assert tables["robot"]["rollers"]["count"] == 9


def test_times_of_a_run_are_in_whole_ticks(scenario):
    assert scenario.sim.tick_ns == 10_000_000
    assert scenario.sim.ticks == 6000
    assert scenario.sensor.ticks_per_frame(scenario.sim.tick_s) == 4


def test_the_start_is_in_degrees(write_scenario):
    loaded = load_scenario(write_scenario("[start]\nx_m = 1.0\ny_m = -2.0\nyaw_deg = 90.0"))
    assert loaded.start.pose == Pose2D(1.0, -2.0, math.pi / 2)


@pytest.mark.parametrize(
    ("seconds", "tick_s", "ticks"),
    [(0.0, 0.01, 0), (0.01, 0.01, 1), (0.04, 0.01, 4), (0.3, 0.1, 3), (1e5, 0.01, 10**7)],
)
def test_a_multiple_of_the_tick_is_that_many_ticks(seconds, tick_s, ticks):
    assert whole_ticks("sensor.latency_s", seconds, tick_s) == ticks


@pytest.mark.parametrize("seconds", [0.015, 0.001, 1e-12, 0.0333, 1.0001, math.nan, math.inf])
def test_when_a_time_is_no_multiple_of_the_tick_expect_the_key_and_both(seconds):
    text = error_of(ConfigError, lambda: whole_ticks("sensor.latency_s", seconds, 0.01))
    assert text == f"sensor.latency_s: {seconds:.9g} s is not a whole number of ticks of 0.01 s"


def test_when_the_sensors_rate_does_not_divide_the_tick_rate_expect_its_key(write_scenario):
    loaded = load_scenario(write_scenario("[sensor]\nrate_hz = 30.0"))
    expected = r"sensor\.rate_hz = 30 must divide .* 100 Hz, as 25 and 33"
    with pytest.raises(ConfigError, match=expected):
        loaded.sensor.ticks_per_frame(loaded.sim.tick_s)


def test_processes_meet_at_the_usual_port_unless_something_else_is_said():
    assert BusConfig().router_endpoints == ("tcp/127.0.0.1:7447",)
    assert BusConfig(connect=("tcp/127.0.0.1:1",)).router_endpoints == ("tcp/127.0.0.1:1",)
    assert BusConfig(zenoh_config=Path("zenoh.json5")).router_endpoints is None
    assert BusConfig(keys=Folder("keys")).router_endpoints == ("tls/127.0.0.1:7447",)


def test_a_path_is_found_from_the_scenario_and_then_from_where_one_is(
    write_scenario, tmp_path, monkeypatch
):
    path = write_scenario("[bus]\nkeys = 'keys'\n")
    (tmp_path / "elsewhere" / "keys").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load_scenario(path).bus.keys == tmp_path / "elsewhere" / "keys"
    (path.parent / "keys").mkdir()
    loaded = load_scenario(path)
    assert loaded.bus.keys == path.parent / "keys"
    assert effective(loaded)["bus"]["keys"] == str(path.parent / "keys")


def test_a_scenario_is_found_by_path_and_by_name_from_any_folder_below(tmp_path, monkeypatch):
    folder, below = tmp_path / "configs" / "scenarios", tmp_path / "some" / "where"
    for each in (folder, below):
        each.mkdir(parents=True)
    for name in ("back", "side"):
        (folder / f"{name}.toml").touch()
    monkeypatch.chdir(below)
    assert scenario_path("back") == folder / "back.toml"
    assert scenario_path(str(folder / "side.toml")) == folder / "side.toml"
    assert scenario_path("../../configs/scenarios/side.toml").samefile(folder / "side.toml")
    expected = "^bak: no such scenario; a path to a TOML file, or one of back, side$"
    with pytest.raises(ConfigError, match=expected):
        scenario_path("bak")


def test_where_there_are_no_scenarios_those_of_the_package_are_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert scenario_path("back").read_bytes() == (SCENARIOS / "back.toml").read_bytes()
    assert load_scenario(scenario_path("back")).robot.name


def test_a_scenario_is_immutable(scenario):
    with pytest.raises(AttributeError):
        scenario.seed = 1
    assert isinstance(scenario, Scenario)
