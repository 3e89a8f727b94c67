"""Scenarios from files and settings, and values that follow from them: ticks, seeds, namespaces.

Wrong ones: test_wrong_inputs.
"""

import math
import os
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
import toys
from harness import ROBOTS, ROOT, SCENARIOS, error_of
from mecazen.config import ControllerConfig, SimConfig
from mecazen.config.follower import PidControl
from mecazen.config.people import Standing, Straight
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import (
    load_scenario,
    renamed_in,
    robots_in,
    scenario_path,
    to_toml,
    with_settings,
)
from mecazen.robot import Payload
from mecazen.robots import seed_of
from mecazen.ticks import whole_ticks

TWO = "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {y_m = 1.5}\n"


def test_settings_of_python_are_values(scenario):
    settings = {"robot": ROBOTS / "artbul.toml", "sim.speed": np.float64(2.0), "follower": {}}
    loaded = with_settings(scenario, settings | {"follower.planner": None, "start": scenario.start})
    assert (loaded.robot.name, loaded.sim.speed, loaded.seed) == ("artbul", 2.0, scenario.seed)


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
    plain = load_scenario(write_scenario('robot = "nexus"\n', robot=""))
    assert msgspec.structs.replace(loaded.robot, payload=None) == plain.robot
    ward = load_scenario(path, {"world": "ward"}).world
    assert ward == load_scenario(path, {"world": ROOT / "configs/worlds/ward.toml"}).world


def test_a_saved_configuration_allows_another_choice(tmp_path):
    path = tmp_path / "saved.toml"
    path.write_text(to_toml(load_scenario(scenario_path("convoy"))))
    settings = {"follower.control.x.kp": 1, "follower.control.kind": "pid"}
    assert isinstance(load_scenario(path, settings).of("two").follower.control, PidControl)
    assert load_scenario(path, {"sensor.kind": "legs"}).sensor.kind == "legs"


@pytest.mark.parametrize("origin", ["the file", "a setting"])
def test_paths_are_relative_to_their_origin(write_scenario, tmp_path, monkeypatch, origin):
    settings = {
        "robot": "mine.toml",
        "world": "place.toml",
        "target.path.file": "walk.csv",
        "bus.keys": "keys",
        "programs.follower": "my.py:Mine",
        "recorder.file": "mine.mcap",
    }
    recorded = "target.path.kind = 'recorded'\n"
    lines = "".join(f"{key} = '{value}'\n" for key, value in settings.items())
    path = write_scenario(f"{recorded}{lines}" if origin == "the file" else recorded, robot="")
    folder = path.parent if origin == "the file" else tmp_path / "here"
    (folder / "keys").mkdir(parents=True)
    (folder / "walk.csv").touch()
    (folder / "place.toml").write_text("ground_friction = 0.5\n")
    shutil.copy(ROBOTS / "artbul.toml", folder / "mine.toml")
    monkeypatch.chdir(folder)
    name = Path("..") / "scenarios" / "test.toml"
    loaded = load_scenario(name, {} if origin == "the file" else settings)
    assert (loaded.robot.name, loaded.world.ground_friction) == ("artbul", 0.5)
    assert (loaded.target.path.file, loaded.bus.keys) == (folder / "walk.csv", folder / "keys")
    assert loaded.programs == {"follower": f"{folder / 'my.py'}:Mine"}
    assert loaded.recorder.file == folder / "mine.mcap"


def test_the_effective_configuration_loads_again_to_the_same(write_scenario, tmp_path):
    shutil.copy(toys.__file__, tmp_path / "my.py")
    path = write_scenario(
        "seed = 7\n[programs]\nfollower = 'missing.py:Mine'\nmine = '../my.py:Mine'\n"
        "[sim]\ntick_s = 0.02\n[sensor]\nocclusions_s = [[1.0, 2.5]]\n"
        "[bus]\nnamespace = 'a/b'\n[mine.walk]\nkind = 'fast'\nspeed_m_s = 0.1\n"
        f"{TWO}target.path.kind = 'standing'\n"
    )
    loaded = load_scenario(path)
    again = tmp_path / "again.toml"
    again.write_text(to_toml(loaded))
    assert load_scenario(again) == loaded
    assert robots_in(again.read_text()) == ("one", "two")
    assert robots_in("no TOML") == ("",)


def test_keys_on_the_bus_are_those_of_each_robot(write_scenario):
    path = write_scenario(f"{TWO}controller.odometry_key = 'odo'\n")
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
    shutil.copy(ROBOTS / "artbul.toml", tmp_path / "robots")
    loaded = load_scenario(path, {"robots.two.start.x_m": 4.0, "target.gait.sway_m": 0.05})
    one, two = loaded.of("one"), loaded.of("two")
    assert (one.robot.name, two.robot.name) == ("nexus", "artbul")
    assert one.target.path == Straight(speed_m_s=0.5, length_m=4.0)
    assert two.target.path == Standing(x_m=3.0)
    assert one.target.gait.sway_m == two.target.gait.sway_m == 0.05
    assert two.start.pose == Pose2D(4.0, 0.0, 0.0)
    assert (one.sensor.rate_hz, one.sensor.fov_deg) == (50.0, 90.0)
    assert (two.sensor.rate_hz, two.sensor.fov_deg) == (25.0, 90.0)


def test_each_robot_has_its_namespace_seed_and_services(write_scenario, scenario):
    path = write_scenario(f"seed = 7\nservices = ['physics', 'target', 'viewer']\n{TWO}")
    loaded = load_scenario(path, {"bus.namespace": "lab"})
    one, two = (loaded.of(name) for name in loaded.names)
    assert (one.bus.namespace, two.bus.namespace) == ("lab/one", "lab/two")
    assert (one.seed, two.seed) == (seed_of(7, "one"), seed_of(7, "two"))
    assert len({loaded.seed, one.seed, two.seed}) == 3
    assert one.names == ("",)
    assert loaded.parts == (("physics", ""), ("target", "one"), ("target", "two"), ("viewer", ""))
    assert scenario.of("") is scenario
    for robots, name, known in ((loaded, "three", "one, two"), (scenario, "one", "none")):
        line = error_of(ConfigError, lambda robots=robots, name=name: robots.of(name))
        assert line.startswith(f"{name!r}: no such robot in the scenario; its robots: {known}")


def test_a_scenario_has_a_path_or_a_name(tmp_path, monkeypatch):
    folder, below = tmp_path / "configs" / "scenarios", tmp_path / "some" / "where"
    for parent in (folder, below / "back"):
        parent.mkdir(parents=True)
    for name in ("back", "side"):
        (folder / f"{name}.toml").touch()
    monkeypatch.chdir(below)
    assert scenario_path("back") == folder / "back.toml"
    assert scenario_path(str(folder / "side.toml")) == folder / "side.toml"
    allowed = "a path to a TOML file, or one of back, side"
    for name, line in (
        ("bak", f"bak: no such scenario; did you mean back? {allowed}"),
        ("bak.toml", f"bak.toml: no such file; {allowed}"),
        ("a\nb", rf"a\nb: no such scenario; {allowed}"),
        ("", f"'': no such scenario; {allowed}"),
    ):
        assert error_of(ConfigError, lambda name=name: scenario_path(name)) == line
    monkeypatch.chdir(os.sep)
    assert scenario_path("back").read_bytes() == (SCENARIOS / "back.toml").read_bytes()


def test_times_are_in_whole_ticks(scenario):
    assert (scenario.sim.tick_ns, scenario.sim.ticks) == (10_000_000, 6000)
    assert scenario.ticks_per("sensor.rate_hz") == 4
    for seconds, tick_s, ticks in ((0.0, 0.01, 0), (0.3, 0.1, 3), (1e5, 0.01, 10**7)):
        assert whole_ticks("sensor.latency_s", seconds, tick_s) == ticks
    for seconds in (0.015, 1e-12, 1.0001, math.nan, math.inf):
        text = error_of(ConfigError, lambda s=seconds: whole_ticks("sensor.latency_s", s, 0.01))
        assert text == f"sensor.latency_s: {seconds:.9g} s is not a whole number of ticks of 0.01 s"


def test_rates_divide_the_tick_rate(scenario):
    controller = ControllerConfig(update_rate_hz=20.0)
    scenario = msgspec.structs.replace(scenario, sim=SimConfig(tick_s=0.005), controller=controller)
    rates = (None, 50.0, "sensor.rate_hz", "controller.update_rate_hz", "controller.half_track_m")
    assert [scenario.ticks_per(rate) for rate in rates] == [1, 4, 8, 10, 1]
    for rate, line in (
        (300.0, "rate = 300 must divide the tick rate of 200 Hz"),
        ("sensor.rate", "sensor.rate: a node's rate that is no number"),
        ("sim.mode", "sim.mode: a node's rate that is no number"),
        ("nobody.rate_hz", "nobody.rate_hz: a node's rate that is no number"),
    ):
        assert error_of(ConfigError, lambda rate=rate: scenario.ticks_per(rate)).startswith(line)
