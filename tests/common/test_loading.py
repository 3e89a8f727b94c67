"""Scenarios from files: what is loaded, and one line for each wrong input."""

import os
from pathlib import Path

import msgspec
import numpy as np
import pytest
import tomli_w
from common.sections import TOY, problem
from harness import ROBOTS, ROOT, SCENARIOS, error_of
from mecazen.config.people import Standing, Straight
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import (
    effective,
    load_scenario,
    parse_settings,
    renamed_in,
    robots_in,
    scenario_path,
    to_toml,
    with_settings,
)
from mecazen.robot import Payload

NEXUS = 'robot = "../robots/nexus.toml"\n'
TWO = f"{NEXUS}[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {{y_m = 1.5}}\n"
TOYS = f"{NEXUS}programs.toy = '../toy.py:ToyNode'\n"
TICK = "allowed: a number >= 0.001 and <= 1"
TEST = "scenarios/test.toml"
BRIDGE = "ros_bridge = ['tcp/localhost:7447']"

WRONG = [
    # keys
    ("seeed = 1", (), f"{TEST}: seeed: unknown key; did you mean seed? allowed: bus, controller,"),
    ("[sim]\ntik_s = 1.0", (), f"{TEST}: sim.tik_s: unknown key; did you mean tick_s? allowed: "),
    ("standoff_m = 1.0", (), f"{TEST}: standoff_m: unknown key; did you mean follower.standoff_m?"),
    ("robot_name = 'a'", (), f"{TEST}: unknown key 'robot_name'"),
    ('[sim]\n"two\\nlines" = 1', (), rf"{TEST}: sim.two\nlines: unknown key; allowed: "),
    # values
    ("[sim]\ntick_s = 'fast'", (), f"{TEST}: sim.tick_s: got 'fast'; {TICK}"),
    ("[sim]\ntick_s = true", (), f"{TEST}: sim.tick_s: got true; {TICK}"),
    ("[sim]\ntick_s = 2020-01-01", (), f"{TEST}: sim.tick_s: got 2020-01-01; {TICK}"),
    ("[sim]\ntick_s = 0.0100000001234", (), f"{TEST}: sim.tick_s = 0.0100000001234 must be whole"),
    ("[sim]\nduration_s = 0.001", (), f"{TEST}: sim.duration_s = 0.001 must be at least a tick of"),
    ("[sim]\nmode = 'fast'", (), f"{TEST}: sim.mode: got 'fast'; allowed: 'lockstep' or 'real_t"),
    ("sim = 3", (), f"{TEST}: sim: got 3; allowed: a table"),
    ("seed = -1", (), f"{TEST}: seed: got -1; allowed: a whole number >= 0 and <= 4294967295"),
    (f"seed = {'9' * 300}", (), f"{TEST}: seed: got a number of too many digits; allowed: "),
    ("services = 'physics'", (), f"{TEST}: services: got 'physics'; allowed: a list, each a strin"),
    ("services = ['physics', 3]", (), f"{TEST}: services.1: got 3; allowed: a string"),
    ("services = ['physics', 'physics']", (), f"{TEST}: services: each at most once"),
    ("[programs]\ntarget = 3", (), f"{TEST}: programs: got {{'target': 3}}; allowed: a table, eac"),
    ("[bus]\nnamespace = '/robot'", (), f"{TEST}: bus.namespace: got '/robot'; allowed: a string"),
    ("[bus]\nzenoh_config = 3", (), f"{TEST}: bus.zenoh_config: got 3; allowed: a path"),
    ("[bus]\nzenoh_config = 'x'", (), f"{TEST}: bus.zenoh_config: scenarios/x: no such file"),
    ("[bus]\nkeys = 'x'", (), f"{TEST}: bus.keys: scenarios/x: no such folder"),
    ("[bus]\nros2 = true\nnamespace = '1'", (), f"{TEST}: bus: ros2: '1' can't be a namespace in"),
    (f"[bus]\n{BRIDGE}", (), f"{TEST}: bus: ros_bridge: this is mecazen's own router, where th"),
    (f"[bus]\n{BRIDGE}\nros_connect = ['tcp/r:1']", (), f"{TEST}: bus: ros_bridge and ros_connec"),
    ("[viewer]\nweb_port = 80\ndata_port = 80", (), f"{TEST}: viewer: web_port and data_port must"),
    ("[sensor]\nocclusions_s = [[1.0]]", (), f"{TEST}: sensor.occlusions_s.0: got [1.0]; allowed"),
    ("[sensor]\nocclusions_s = [[2, 1]]", (), f"{TEST}: sensor: occlusions_s: [2.0, 1.0] must end"),
    (
        "sensors.tracker.max_range_m = 0.4",
        (),
        f"{TEST}: sensors.tracker: min_range_m = 0.5 must be",
    ),
    (
        "sensors.depth.edge_probability = 0.6",
        (),
        f"{TEST}: sensors.depth: edge_probability must be at most 0.5",
    ),
    (f"seed = {'9' * 5000}", (), f"{TEST}: not TOML: "),
    (f"seed = {'[' * 5000}", (), f"{TEST}: not TOML: nested too deep"),
    # settings of the command line
    ("", ("seeed=1",), f"{TEST} with seeed: unknown key; did you mean seed? allowed: "),
    ("", ("seed=",), f"{TEST} with seed: got ''; allowed: a whole number"),
    ("", ("seed=1\nsim.speed=2",), rf"{TEST} with seed: got '1\nsim.speed=2'; allowed: "),
    ("", ("sim.mode.x=3",), f"{TEST} with sim.mode.x: sim.mode: got a table; allowed: 'lockstep' "),
    ("", ("sim.tick_s=0.0100000001234",), f"{TEST} with sim.tick_s: sim.tick_s = 0.01000"),
    ("", ("sensor.occlusions_s=[[2,1]]",), f"{TEST} with sensor.occlusions_s: sensor: occlusions_"),
    ("seed = 1", ("seed.x=3",), "seed.x: seed is not a table"),
    ("[sim]\nmode = 1", ("sim.speed=2",), f"{TEST}: sim.mode: got 1"),
    ("[sensor]\nocclusions_s = [[2, 1]]", ("sensor.fov_deg=30",), f"{TEST}: sensor: occlusions_s:"),
    *(("", (text,), "--set ") for text in ("seed", "=3", "a b=3", ".seed=1", "seed.=1", "a\nb")),
    *(("", (f"seed={v}",), f"--set seed: {v}: not TOML: ") for v in ("[1,", "{a=1", '"a', "[1] 2")),
    (
        "",
        ("target.body.limp={}",),
        f"{TEST}: target.body and crowd: no sensor sees how",
    ),
    # sections of user nodes
    (
        f"{TOYS}[toy]\nwolk = 1",
        (),
        f"{TEST}: toy.wolk: unknown key; did you mean walk? allowed: li",
    ),
    (
        f"{TOYS}[toy.walk]\nkind = 'fst'",
        (),
        f"{TEST}: toy.walk.kind: got 'fst'; allowed: 'slow' or",
    ),
    (f"{TOYS}[toy.walk]\nspeed_m_s = 1.0", (), f"{TEST}: toy.walk.kind: missing"),
    (f"{TOYS}[toy]\nwalk = 3", (), f"{TEST}: toy.walk: got 3; allowed: "),
    (f"{TOYS}[toy.walk]\nkind = 'fast'", (), f"{TEST}: toy.walk.speed_m_s: missing"),
    (
        f"{TOYS}[toy.walk]\nkind = 'fast'\nspeed = 1",
        (),
        f"{TEST}: toy.walk.speed: unknown key; did",
    ),
    (
        f"{TOYS}[toy.weights]\nb = 'x'",
        (),
        f"{TEST}: toy.weights: got {{'b': 'x'}}; allowed: a tabl",
    ),
    (f"{TOYS}[toy]\nlimit = 'none'", (), f"{TEST}: toy.limit: got 'none'; allowed: a number > 0"),
    (
        f"{TOYS}[toy]\nmixed = true",
        (),
        f"{TEST}: toy.mixed: got true; allowed: a number or a strin",
    ),
    # the robot
    ("seed = 1", None, f"{TEST}: robot: missing"),
    ("robot = 5", (), f"{TEST}: robot: got 5; allowed: a table"),
    ("robot = { file = 'none.toml' }", (), "scenarios/none.toml: can't be read: No such file or"),
    ("robot = 'none.toml'", (), "scenarios/none.toml: can't be read: No such file or directory"),
    ("robot = 'nexsu'", (), f"{TEST}: robot: nexsu: no such robot; did you mean nexus? a path to"),
    ("robot = '../robots'", (), "robots: can't be read: Is a directory"),
    ('robot = "a\\u0000b"', (), r"scenarios/a\u0000b: can't be read: embedded null byte"),
    ("", ("robot=none",), f"{TEST} with robot: robot: none: no such robot; a path to a TOML file"),
    (
        "[robot]\nname = 'x'\nbase = { mass_kg = 1.0 }",
        (),
        f"{TEST}: robot.base.length_m, robot.base.width_m, robot.base.height_m, "
        "robot.base.clearance_m, robot.wheels, robot.rollers: missing",
    ),
    ("", ("robot.wheels.raduis_m=1",), f"{TEST} with robot.wheels.raduis_m: unknown key; did you"),
    (
        "",
        ("robot.wheels.radius_m=47.5",),
        f"{TEST} with robot.wheels.radius_m: got 47.5; allowed: a number > 0 and <= 0.5; 47.5 "
        "looks like millimetres",
    ),
    (
        "",
        ("robot.base.mass_kg=12000",),
        f"{TEST} with robot.base.mass_kg: got 12000; allowed: a number > 0 and <= 2000; 12000 "
        "looks like grams",
    ),
    ("", ("robot.camera.size_m=[1.0]",), f"{TEST} with robot.camera.size_m: got [1.0]; allowed"),
    # several robots
    ("robots = 'one'", (), f"{TEST}: robots: got 'one'; allowed: a list, each a table"),
    ("[[robots]]\nstart = {x_m = 1.0}", (), f"{TEST}: robots.0.name: missing"),
    ("[[robots]]\nname = 'sim'", (), f"{TEST}: robots.sim: name = 'sim' begins a key of mecazen's"),
    (TWO.replace("two", "one"), (), f"{TEST}: robots: each name at most once"),
    (TWO.replace("1.5", "0.3"), (), f"{TEST}: robots: one and two overlap at their starts"),
    (TWO, ("robots.three.start.x_m=2.0",), "robots.three.start.x_m: robots are one, two"),
    ("[[robots]]\nname = 'a'\nphysics = {}", (), f"{TEST}: robots.a.physics: unknown key; allowed"),
    ("[[robots]]\nname = 'a'\nsensor.rate_hz = 0", (), f"{TEST}: robots.a.sensor.rate_hz: got 0;"),
    (
        "[[robots]]\nname = 'a'\nsensor.kind = 'body'",
        (),
        f"{TEST}: robots: a: sensor.kind and sens",
    ),
    # the guard and the world
    ("", ("guard.margin_m=0",), f"{TEST} with guard.margin_m: got 0; allowed: a number >= 0.05"),
    ("[world]\nwals = []", (), f"{TEST}: world.wals: unknown key; did you mean walls? allowed: "),
    ("[world]\nmap = 'none.yaml'", (), "scenarios/none.yaml: can't be read: No such file or dire"),
    ("world.walls = [{ points_m = [[0, 0]] }]", (), f"{TEST}: world.walls.0.points_m: got [[0, 0]"),
    (
        "world.walls = [{ points_m = [[0, 0], [0, 0]] }]",
        (),
        f"{TEST}: world.walls.0: points_m: two",
    ),
    (
        "world.walls = [{ points_m = [[0, 0], [2, 0]], doors = [{ at_m = 1.9, width_m = 1.0 }] }]",
        (),
        f"{TEST}: world.walls.0: doors: one from 1.4 m to 2.4 m along the wall is not within one",
    ),
    (
        "world.ramps = [{ length_m = 1, width_m = 1, rise_m = 0.1, position_m = [0, 0] }]",
        (),
        f"{TEST}: world.ramps.0: rise_m = 0.1 must be at most 8% of length_m = 1",
    ),
]


@pytest.mark.parametrize(("text", "overrides", "line"), WRONG)
def test_a_wrong_input_is_one_line(write_scenario, tmp_path, text, overrides, line):
    (tmp_path / "toy.py").write_text(TOY)
    has_robot = text.startswith(("robot =", "[robot]", NEXUS)) or overrides is None
    path = write_scenario(text, robot="" if has_robot else NEXUS)
    assert problem(path, *(overrides or ())).startswith(line)


def test_an_error_in_a_robot_file_names_that_file(write_scenario):
    path = write_scenario()
    robot = path.parents[1] / "robots" / "nexus.toml"
    robot.write_text(robot.read_text().replace("count = 9", "count = 'nine'"))
    assert problem(path).startswith("robots/nexus.toml: rollers.count: got 'nine'; allowed: ")
    robot.write_text("name = ")
    assert problem(path).startswith("robots/nexus.toml: not TOML: ")


@pytest.mark.parametrize(
    ("override", "read", "expected"),
    [
        ("sim.mode=lockstep", lambda s: s.sim.mode, "lockstep"),
        (" sim.speed = 2.5 ", lambda s: s.sim.speed, 2.5),
        ('bus.connect=["tcp/127.0.0.1:1"]', lambda s: s.bus.connect, ("tcp/127.0.0.1:1",)),
        ("start={x_m=2.0}", lambda s: s.start.pose, Pose2D(2.0, 0.0, 0.0)),
        ("robot.wheels.track_m=0.4", lambda s: s.robot.half_track, 0.2),
        ("robot=nexus", lambda s: s.robot.name, "nexus"),
    ],
)
def test_a_setting_is_in_toml_or_a_bare_word(write_scenario, override, read, expected):
    assert read(load_scenario(write_scenario(), parse_settings((override,)))) == expected


def test_settings_of_python_are_values(scenario):
    settings = {"robot": ROBOTS / "artbul.toml", "sim.speed": np.float64(2.0), "follower": {}}
    loaded = with_settings(scenario, settings | {"follower.planner": None, "start": scenario.start})
    assert (loaded.robot.name, loaded.sim.speed, loaded.seed) == ("artbul", 2.0, scenario.seed)
    line = error_of(ConfigError, lambda: with_settings(scenario, {"seed": object()}))
    assert line.startswith("seed: got <object object")


def test_files_that_come_with_the_package_have_names(write_scenario):
    path = f"{ROOT}/configs/worlds/ward.toml"
    by_path = load_scenario(write_scenario(f'world = "{path}"\n'))
    by_name = load_scenario(write_scenario('world = "ward"\n', robot='robot = "nexus"\n'))
    assert (by_name.robot, by_name.world) == (by_path.robot, by_path.world)


def test_a_scenario_changes_parts_of_files(write_scenario, tmp_path):
    (tmp_path / "place.toml").write_text(
        "ground_friction = 0.7\nwalls = [{points_m=[[0,0],[2,0]]}]"
    )
    path = write_scenario(
        'robot.file = "../robots/nexus.toml"\n'
        "robot.payload = { mass_kg = 2.0, position_m = [0.0, 0.1, 0.3] }\n"
        "world = { file = '../place.toml', ground_friction = 0.5, person = { radius_m = 0.3 } }\n",
        robot="",
    )
    loaded = load_scenario(path)
    assert loaded.robot.payload == Payload(mass_kg=2.0, position_m=(0.0, 0.1, 0.3))
    world = loaded.world
    assert (world.ground_friction, world.person.radius_m, len(world.walls)) == (0.5, 0.3, 1)
    assert load_scenario(path, {"robot.payload.mass_kg": 3}).robot.payload.mass_kg == 3.0
    plain = load_scenario(write_scenario()).robot
    assert msgspec.structs.replace(loaded.robot, payload=None) == plain


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("back", {"follower.control.x.kp": 1, "follower.control.kind": "pid"}),
        ("back", {"target.path.kind": "standing"}),
        ("back", {"sensor.kind": "legs"}),
        ("convoy", {"robots.two.follower.control.kind": "pid"}),
    ],
)
def test_a_saved_configuration_allows_another_choice(tmp_path, scenario, settings):
    path = tmp_path / "saved.toml"
    path.write_text(to_toml(load_scenario(scenario_path(scenario))))
    table = effective(load_scenario(path, settings))
    for name in [*settings][-1].split("."):
        table = {robot["name"]: robot for robot in table} if isinstance(table, list) else table
        table = table[name]
    assert table == [*settings.values()][-1]


def test_another_kind_keeps_common_keys_of_the_file(write_scenario):
    path = write_scenario("[target.path]\nkind = 'u_track'\nspeed_m_s = 0.7\nlength_m = 4.0\n")
    loaded = load_scenario(path, {"target.path.kind": "circle"}).target.path
    assert (loaded.speed_m_s, type(loaded).__name__) == (0.7, "Circle")


def test_paths_are_relative_to_their_origin(write_scenario, tmp_path, monkeypatch):
    path = write_scenario(
        "[target.path]\nkind = 'recorded'\nfile = 'walk.csv'\n[bus]\nzenoh_config = 'zenoh.json5'\n"
        "[programs]\nfollower = 'my.py:Mine'\n[recorder]\nfile = 'mine.mcap'\n"
    )
    folder, here = path.parent, tmp_path / "here"
    (here / "keys").mkdir(parents=True)
    for file in (folder / "walk.csv", folder / "zenoh.json5", here / "walk.csv"):
        file.touch()
    (here / "place.toml").write_text("ground_friction = 0.5\n")
    (here / "mine.toml").write_text((ROBOTS / "artbul.toml").read_text())
    monkeypatch.chdir(here)
    loaded = load_scenario(Path("..") / "scenarios" / "test.toml")
    assert loaded.target.path.file == folder / "walk.csv"
    assert loaded.bus.zenoh_config == folder / "zenoh.json5"
    assert loaded.programs == {"follower": f"{folder / 'my.py'}:Mine"}
    assert loaded.recorder.file == folder / "mine.mcap"
    changed = load_scenario(
        path,
        {
            "robot": "mine.toml",
            "world": "place.toml",
            "target.path.file": "walk.csv",
            "bus.keys": "keys",
            "programs.follower": "my.py:Mine",
            "recorder.file": "mine.mcap",
        },
    )
    assert (changed.robot.name, changed.world.ground_friction) == ("artbul", 0.5)
    assert (changed.target.path.file, changed.bus.keys) == (here / "walk.csv", here / "keys")
    assert changed.programs == {"follower": f"{here / 'my.py'}:Mine"}
    assert changed.recorder.file == here / "mine.mcap"


def test_the_effective_configuration_loads_again_to_the_same(write_scenario, tmp_path):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(
        "seed = 7\n[programs]\nfollower = 'my.py:Mine'\ntoy = '../toy.py:ToyNode'\n"
        "[sim]\ntick_s = 0.02\n[sensor]\nocclusions_s = [[1.0, 2.5]]\n"
        "[bus]\nnamespace = 'a/b'\n[toy.walk]\nkind = 'fast'\nspeed_m_s = 0.1\n"
        "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {y_m = 1.5}\n"
        "target.path.kind = 'standing'\n"
    )
    loaded = load_scenario(path)
    again = tmp_path / "again.toml"
    again.write_text(tomli_w.dumps(effective(loaded)))
    assert load_scenario(again) == loaded
    assert robots_in(again.read_text()) == ("one", "two")
    assert robots_in("no TOML") == ("",)


def test_keys_on_the_bus_are_those_of_each_robot(write_scenario):
    path = write_scenario(f"{TWO.removeprefix(NEXUS)}controller.odometry_key = 'odo'\n")
    loaded = load_scenario(path, {"controller.command_key": "drive"})
    assert renamed_in(to_toml(loaded)) == loaded.renamed
    assert loaded.renamed == {
        "one/cmd_vel": "one/drive",
        "two/cmd_vel": "two/drive",
        "two/odom": "two/odo",
    }


def test_robots_differ_in_their_robot_and_sections(write_scenario, tmp_path):
    path = write_scenario(
        "[target.path]\nkind = 'straight'\nspeed_m_s = 0.5\nlength_m = 3.0\n"
        "[sensor]\nfov_deg = 90.0\n"
        "[[robots]]\nname = 'one'\ntarget.path.length_m = 4.0\nsensor.rate_hz = 50.0\n"
        "[[robots]]\nname = 'two'\nstart = {x_m = 2.0}\nrobot = '../robots/artbul.toml'\n"
        "target.path = {kind = 'standing', x_m = 3.0}\n"
    )
    (tmp_path / "robots" / "artbul.toml").write_text((ROBOTS / "artbul.toml").read_text())
    loaded = load_scenario(path, {"robots.two.start.x_m": 4.0, "target.gait.sway_m": 0.05})
    one, two = loaded.of("one"), loaded.of("two")
    assert (one.robot.name, two.robot.name) == ("nexus", "artbul")
    assert one.target.path == Straight(speed_m_s=0.5, length_m=4.0)
    assert two.target.path == Standing(x_m=3.0)
    assert one.target.gait.sway_m == two.target.gait.sway_m == 0.05
    assert two.start.pose == Pose2D(4.0, 0.0, 0.0)
    assert (one.sensor.rate_hz, one.sensor.fov_deg) == (50.0, 90.0)
    assert (two.sensor.rate_hz, two.sensor.fov_deg) == (25.0, 90.0)


def test_services_that_sensors_and_walkers_need_are_added(write_scenario):
    listed = "services = ['physics', 'controller', 'target']\n"
    path = write_scenario(f"{listed}sensor.kind = 'fused'\n")
    assert load_scenario(path).services[3:] == ("sensors", "follower", "guard")
    assert load_scenario(path, {"sensor.kind": "pose"}).services[-1] == "target"
    walkers = {"crowd.walkers": [{"path": {"kind": "standing", "x_m": 3.0}}]}
    assert load_scenario(path, walkers).services[-1] == "crowd"


def test_a_scenario_has_a_path_or_a_name(tmp_path, monkeypatch):
    folder, below = tmp_path / "configs" / "scenarios", tmp_path / "some" / "where"
    for parent in (folder, below / "back"):
        parent.mkdir(parents=True)
    for name in ("back", "side"):
        (folder / f"{name}.toml").touch()
    monkeypatch.chdir(below)
    assert scenario_path("back") == folder / "back.toml"
    assert scenario_path(str(folder / "side.toml")) == folder / "side.toml"
    assert scenario_path("../../configs/scenarios/side.toml").samefile(folder / "side.toml")
    allowed = "a path to a TOML file, or one of back, side"
    for name, line in (
        ("bak", f"bak: no such scenario; did you mean back? {allowed}"),
        ("bak.toml", f"bak.toml: no such file; {allowed}"),
        ("a\nb", rf"a\nb: no such scenario; {allowed}"),
        ("", f"'': no such scenario; {allowed}"),
        (str(below), f"{below}: no such scenario; {allowed}"),
    ):
        assert error_of(ConfigError, lambda name=name: scenario_path(name)) == line
    monkeypatch.chdir(os.sep)
    assert scenario_path("back").read_bytes() == (SCENARIOS / "back.toml").read_bytes()
