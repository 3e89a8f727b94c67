"""Several robots in a scenario: their parts of it, and what is wrong with them in one line."""

import tomllib

import pytest
import tomli_w
from harness import ROBOTS, error_of
from mecazen.config.people import Standing, Straight
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import effective, load_scenario, parse_settings, robots_in, to_toml
from mecazen.robots import seed_of, split_key

TWO = "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {y_m = 1.5}\n"


def test_a_scenario_without_robots_is_that_of_its_only_one(scenario):
    assert scenario.names == ("",)
    assert scenario.of("") is scenario
    assert scenario.parts == tuple((part, "") for part in scenario.services)


def test_each_robot_has_its_start_namespace_seed_and_services(write_scenario):
    path = write_scenario(f"seed = 7\nservices = ['physics', 'target', 'viewer']\n{TWO}")
    loaded = load_scenario(path, {"bus.namespace": "lab"})
    one, two = (loaded.of(name) for name in loaded.names)
    assert (one.start.pose, two.start.pose) == (Pose2D(), Pose2D(0.0, 1.5, 0.0))
    assert (one.bus.namespace, two.bus.namespace) == ("lab/one", "lab/two")
    assert len({loaded.seed, one.seed, two.seed}) == 3
    assert (one.seed, two.seed) == (seed_of(7, "one"), seed_of(7, "two"))
    assert one.names == ("",)
    assert loaded.parts == (("physics", ""), ("target", "one"), ("target", "two"), ("viewer", ""))


def test_a_robot_may_be_another_and_its_services_may_differ(write_scenario, tmp_path):
    path = write_scenario(
        "[target.path]\nkind = 'straight'\nspeed_m_s = 0.5\nlength_m = 3.0\n"
        "[sensor]\nfov_deg = 90.0\n"
        "[[robots]]\nname = 'one'\ntarget.path.length_m = 4.0\nsensor.rate_hz = 50.0\n"
        "[[robots]]\nname = 'two'\nstart = {x_m = 2.0}\nrobot = '../robots/artbul.toml'\n"
        "target.path = {kind = 'standing', x_m = 3.0}\n"
    )
    (tmp_path / "robots" / "artbul.toml").write_text((ROBOTS / "artbul.toml").read_text())
    loaded = load_scenario(path)
    one, two = loaded.of("one"), loaded.of("two")
    assert (one.robot.name, two.robot.name) == ("nexus", "artbul")
    assert one.target.path == Straight(speed_m_s=0.5, length_m=4.0)
    assert two.target.path == Standing(x_m=3.0)
    assert (one.sensor.rate_hz, one.sensor.fov_deg) == (50.0, 90.0)
    assert (two.sensor.rate_hz, two.sensor.fov_deg) == (25.0, 90.0)
    assert loaded.target.path == Straight(speed_m_s=0.5, length_m=3.0)


def test_the_effective_configuration_of_robots_loads_again_to_the_same(write_scenario, tmp_path):
    loaded = load_scenario(
        write_scenario(f"{TWO}target.path = {{kind = 'standing'}}\nfollower.view = 'side_left'\n")
    )
    assert loaded.of("two").follower.view == "side_left"
    again = tmp_path / "again.toml"
    again.write_text(tomli_w.dumps(effective(loaded)))
    assert load_scenario(again) == loaded
    assert tomllib.loads(again.read_text())["robots"][0]["name"] == "one"


def test_whose_a_key_is_is_told_by_the_names_of_a_configuration(write_scenario):
    names = robots_in(to_toml(load_scenario(write_scenario(TWO))))
    assert names == ("one", "two")
    assert split_key("two/target/odom", names) == ("two", "target/odom")
    assert split_key("target/odom", names) == ("", "target/odom")
    assert split_key("three/odom", names) == ("", "three/odom")
    for text in (to_toml(load_scenario(write_scenario())), "robots = 3", "no TOML"):
        assert robots_in(text) == ("",)
    assert split_key("odom", ("",)) == ("", "odom")


def test_an_override_reaches_one_robot_by_its_name_or_all(write_scenario):
    path = write_scenario(TWO)
    of_two = "robots.two.start.x_m=2.0", "robots.two.target.gait.sway_m=0.1"
    loaded = load_scenario(path, parse_settings(("target.gait.sway_m=0.05", *of_two)))
    assert loaded.of("two").start.pose == Pose2D(2.0, 1.5, 0.0)
    assert loaded.of("one").target.gait.sway_m == 0.05
    assert loaded.of("two").target.gait.sway_m == 0.1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("robots = 'one'", "robots: got 'one'; allowed: a list, each a table"),
        ("[[robots]]\nstart = {x_m = 1.0}", "robots.0.name: missing; must be a string that mat"),
        ("[[robots]]\nname = ''", "robots.0.name: got ''; allowed: a string that matches"),
        ("[[robots]]\nname = 'sim'", "robots.sim: name = 'sim' begins a key of mecazen's own"),
        (
            "[[robots]]\nname = 'mecazen'",
            "robots.mecazen: name = 'mecazen' begins a key",
        ),
        (TWO.replace("two", "one"), "robots: each name at most once"),
        (TWO.replace("1.5", "0.3"), "robots: one and two overlap at their starts"),
        ("[[robots]]\nname = 'a'\nphysics = {}", "robots.a.physics: unknown key"),
        ("[[robots]]\nname = 'a'\nsensor.rate_hz = 0", "robots.a.sensor.rate_hz: got 0; allowed"),
        ("[[robots]]\nname = 'a'\nrobot = 'none.toml'", "none.toml: can't be read: No such file"),
    ],
)
def test_what_is_wrong_with_robots_is_one_line(write_scenario, text, expected):
    assert expected in error_of(ConfigError, lambda: load_scenario(write_scenario(text)))


def test_when_there_is_no_such_robot_expect_those_there_are(write_scenario, scenario):
    two = load_scenario(write_scenario(TWO)), "one, two"
    for (given, there), name in ((two, "three"), (two, ""), ((scenario, "none"), "one")):
        expected = f"'{name}': no such robot in the scenario; its robots: {there}"
        with pytest.raises(ConfigError, match=expected):
            given.of(name)


@pytest.mark.parametrize("setting", ["robots.three.start.x_m=2.0", "robots.three=2"])
def test_an_override_of_no_robot_is_refused_by_those_there_are(write_scenario, setting):
    key = setting.partition("=")[0]
    with pytest.raises(ConfigError, match=f"^--set {key}: robots are one, two$"):
        load_scenario(write_scenario(TWO), parse_settings((setting,)))
