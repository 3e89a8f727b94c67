"""A scenario is checked as a whole, and an error is one line that names its place."""

import os
from pathlib import Path

import msgspec
import pytest
import tomli_w
from common.sections import TOY, problem
from harness import ROOT, SCENARIOS, error_of
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import effective, load_scenario, parse_settings, scenario_path, to_toml
from mecazen.robot import Payload

NUMBER_OF_TICKS = "a number >= 0.001 and <= 1"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("seeed=1", "seeed: unknown key; did you mean seed? "),
        ("seed=", "seed: got ''; allowed: "),
        ("seed=1\nsim.speed=2", r"seed: got '1\nsim.speed=2'; allowed: "),
        (f"seed={'9' * 5000}", "seed: got '999999"),
        ("sim.mode.x=3", "sim.mode.x: sim.mode: got a table; allowed: 'lockstep' or 'real_time'"),
        ('services=["a","a"]', "services: services: each at most once"),
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


@pytest.mark.parametrize("value", ["[1,", "{a=1", '"a', "'", "[1] 2"])
def test_a_broken_value_is_no_string(write_scenario, value):
    assert problem(write_scenario(), f"seed={value}").startswith(f"--set seed: {value}: not TOML: ")


def test_when_an_override_goes_into_a_value_expect_that_it_is_no_table(write_scenario):
    assert problem(write_scenario("seed = 1"), "seed.x=3") == "--set seed.x: seed is not a table"


def test_when_the_file_is_wrong_beside_an_override_expect_the_file_alone_named(write_scenario):
    path = write_scenario("[sim]\nmode = 1")
    assert problem(path, "sim.speed=2").startswith("scenarios/test.toml: sim.mode: ")
    path = write_scenario("[sensor]\nocclusions_s = [[2.0, 1.0]]")
    assert problem(path, "sensor.fov_deg=30").startswith("scenarios/test.toml: sensor: occl")


def test_when_the_robot_file_is_wrong_expect_it_named(write_scenario):
    path = write_scenario()
    robot = path.parents[1] / "robots" / "nexus.toml"
    robot.write_text(robot.read_text().replace("count = 9", "count = 'nine'"))
    assert problem(path).startswith("robots/nexus.toml: robot.rollers.count: got 'nine'; allowed: ")
    robot.write_text("name = ")
    assert "nexus.toml: not TOML: " in problem(path)


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
    assert load_scenario(path, {"robot.payload.mass_kg": 3}).robot.payload.mass_kg == 3.0
    assert msgspec.structs.replace(robot, payload=None) == load_scenario(write_scenario()).robot


def test_a_folder_or_a_pipe_in_the_place_of_a_scenario_is_called_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "back").mkdir()
    assert scenario_path("back").name == "back.toml"  # a scenario of this name comes first
    os.mkfifo("pipe")
    for name, words in ((str(tmp_path), "Is a directory"), ("pipe", "not a device or a pipe")):
        assert words in error_of(ConfigError, lambda name=name: load_scenario(scenario_path(name)))


@pytest.mark.parametrize(
    ("override", "read", "expected"),
    [
        ("sim.mode=lockstep", lambda s: s.sim.mode, "lockstep"),
        (" sim.speed = 2.5 ", lambda s: s.sim.speed, 2.5),
        ("bus.multicast_scouting=true", lambda s: s.bus.multicast_scouting, True),
        ('bus.connect=["tcp/127.0.0.1:1"]', lambda s: s.bus.connect, ("tcp/127.0.0.1:1",)),
        ("sensor.occlusions_s=[[1, 2]]", lambda s: s.sensor.occlusions_s, ((1.0, 2.0),)),
        ("start={x_m=2.0}", lambda s: s.start.pose, Pose2D(2.0, 0.0, 0.0)),
        ("robot.wheels.track_m=0.4", lambda s: s.robot.half_track, 0.2),
        ("robot=nexus", lambda s: s.robot.name, "nexus"),
    ],
)
def test_an_override_is_taken_as_toml_and_a_bare_word_as_a_string(
    write_scenario, override, read, expected
):
    assert read(load_scenario(write_scenario(), parse_settings((override,)))) == expected


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("back", ("follower.estimator=kf_cv",)),
        ("back", ("follower.control.x.kp=1", "follower.control.kind=pid")),
        ("back", ("target.path.kind=standing",)),
        ("back", ("sensor.kind=legs",)),
        ("back", ("controller.odometry=ground_truth",)),
        ("convoy", ("robots.two.follower.control.kind=pid",)),
    ],
)
def test_a_saved_configuration_allows_another_choice(tmp_path, scenario, settings):
    path = tmp_path / "saved.toml"
    path.write_text(to_toml(load_scenario(scenario_path(scenario))))
    loaded = load_scenario(path, parse_settings(settings))
    key, _, value = settings[-1].partition("=")
    kept = effective(loaded)
    for name in key.split("."):
        kept = {t["name"]: t for t in kept} if isinstance(kept, list) else kept
        kept = kept[name]
    assert kept == value


def test_another_kind_keeps_common_keys_of_the_file(write_scenario):
    path = write_scenario("[target.path]\nkind = 'u_track'\nspeed_m_s = 0.7\nlength_m = 4.0\n")
    loaded = load_scenario(path, {"target.path.kind": "circle"}).target.path
    assert (loaded.speed_m_s, type(loaded).__name__) == (0.7, "Circle")
    with pytest.raises(ConfigError, match="linear_gain_1_s"):
        load_scenario(path, {"follower.control.linear_gain_1_s": 1, "follower.control.kind": "pid"})


def test_paths_are_relative_to_the_scenario_wherever_it_is_started(
    write_scenario, tmp_path, monkeypatch
):
    path = write_scenario(
        "[bus]\nzenoh_config = 'zenoh.json5'\n[programs]\nfollower = 'my.py:Mine'\n"
        "[recorder]\nfile = 'mine.mcap'\n"
    )
    (path.parent / "zenoh.json5").write_text("{}")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    loaded = load_scenario(Path("..") / "scenarios" / "test.toml")
    assert loaded.bus.zenoh_config == path.parent / "zenoh.json5"
    assert loaded.programs == {"follower": f"{path.parent / 'my.py'}:Mine"}
    assert loaded.recorder.file == path.parent / "mine.mcap"
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


def read_program(scenario):
    return Path(scenario.programs["follower"].partition(":")[0])


@pytest.mark.parametrize(
    ("override", "read", "name"),
    [
        ("target.path={kind='recorded',file='w'}", lambda s: s.target.path.file, "w"),
        ("target.path.file=walk.csv", lambda s: s.target.path.file, "walk.csv"),
        ("bus.keys=keys", lambda s: s.bus.keys, "keys"),
        ("programs.follower=my.py:Mine", read_program, "my.py"),
        ("recorder.file=mine.mcap", lambda s: s.recorder.file, "mine.mcap"),
    ],
)
def test_a_path_of_the_command_line_is_relative_to_the_working_directory(
    write_scenario, tmp_path, monkeypatch, override, read, name
):
    path = write_scenario("[target.path]\nkind = 'recorded'\nfile = 'walk.csv'\n")
    here = tmp_path / "here"
    for folder in (here, path.parent):
        (folder / "keys").mkdir(parents=True)
        for file in ("w", "walk.csv"):
            (folder / file).touch()
    monkeypatch.chdir(here)
    assert load_scenario(path).target.path.file == path.parent / "walk.csv"
    assert read(load_scenario(path, parse_settings((override,)))) == here / name
    if name == "keys":
        (here / "keys").rmdir()
        assert "here/keys: no such folder" in problem(path, override)


def test_robot_world_and_map_of_the_command_line_are_relative_to_the_working_directory(
    write_scenario, tmp_path, monkeypatch
):
    path = write_scenario()
    (tmp_path / "mine.toml").write_text((ROOT / "configs/robots/artbul.toml").read_text())
    (tmp_path / "place.toml").write_text("ground_friction = 0.5\n")
    monkeypatch.chdir(tmp_path)
    loaded = load_scenario(path, {"robot": "mine.toml", "world": "place.toml"})
    assert (loaded.robot.name, loaded.world.ground_friction) == ("artbul", 0.5)
    assert problem(path, "world.map=none.yaml").startswith("none.yaml: can't be read")


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
    allowed = "a path to a TOML file, or one of back, side$"
    for name, said in (
        ("bak", rf"^bak: no such scenario; did you mean back\? {allowed}"),
        ("x", f"^x: no such scenario; {allowed}"),
        ("bak.toml", f"^bak.toml: no such file; {allowed}"),
    ):
        with pytest.raises(ConfigError, match=said):
            scenario_path(name)
    for name, shown in (("a\nb", r"a\\nb"), ("", "''")):
        with pytest.raises(ConfigError, match=f"^{shown}: no such scenario"):
            scenario_path(name)


def test_where_there_are_no_scenarios_those_of_the_package_are_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert scenario_path("back").read_bytes() == (SCENARIOS / "back.toml").read_bytes()
    assert load_scenario(scenario_path("back")).robot.name


def test_a_service_that_the_sensor_needs_is_added_to_those_that_are_listed(write_scenario):
    listed = "services = ['physics', 'controller', 'target', 'follower']\n"
    path = write_scenario(f"{listed}sensor.kind = 'fused'\n")
    assert load_scenario(path).services[-2:] == ("sensors", "guard")
    assert load_scenario(path, {"sensor.kind": "pose"}).services[-1] == "follower"


def test_robots_of_one_world_have_the_same_kind_of_sensor(write_scenario):
    robots = "[[robots]]\nname = 'a'\nsensor.kind = 'body'\n[[robots]]\nname = 'b'\nstart.x_m = 3\n"
    with pytest.raises(ConfigError, match="are the same for all robots"):
        load_scenario(write_scenario(robots))
