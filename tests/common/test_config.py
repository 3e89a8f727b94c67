"""Values that a scenario computes from its settings: times in ticks, robots, the bus."""

import math
from pathlib import Path

import msgspec
import pytest
from harness import error_of
from mecazen.config import BusConfig, ControllerConfig, SimConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.robots import seed_of, split_key
from mecazen.schema import Folder
from mecazen.ticks import whole_ticks

TWO = "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {y_m = 1.5}\n"


def test_times_are_in_whole_ticks(scenario):
    assert (scenario.sim.tick_ns, scenario.sim.ticks) == (10_000_000, 6000)
    assert scenario.sensor.ticks_per_frame(scenario.sim.tick_s) == 4
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


def test_each_robot_has_its_start_namespace_seed_and_services(write_scenario, scenario):
    path = write_scenario(f"seed = 7\nservices = ['physics', 'target', 'viewer']\n{TWO}")
    loaded = load_scenario(path, {"bus.namespace": "lab"})
    one, two = (loaded.of(name) for name in loaded.names)
    assert (one.start.pose, two.start.pose) == (Pose2D(), Pose2D(0.0, 1.5, 0.0))
    assert (one.bus.namespace, two.bus.namespace) == ("lab/one", "lab/two")
    assert (one.seed, two.seed) == (seed_of(7, "one"), seed_of(7, "two"))
    assert len({loaded.seed, one.seed, two.seed}) == 3
    assert one.names == ("",)
    assert loaded.parts == (("physics", ""), ("target", "one"), ("target", "two"), ("viewer", ""))
    assert scenario.of("") is scenario
    assert scenario.parts == tuple((part, "") for part in scenario.services)


def test_an_unknown_robot_is_refused_with_the_known_ones(write_scenario, scenario):
    two = load_scenario(write_scenario(TWO))
    for loaded, name, known in ((two, "three", "one, two"), (two, "", "one, two")):
        line = error_of(ConfigError, lambda s=loaded, name=name: s.of(name))
        assert line == f"{name!r}: no such robot in the scenario; its robots: {known}"
    assert "its robots: none" in error_of(ConfigError, lambda: scenario.of("one"))


def test_a_key_names_its_robot():
    assert split_key("two/target/odom", ("one", "two")) == ("two", "target/odom")
    assert split_key("three/odom", ("one", "two")) == ("", "three/odom")
    assert split_key("odom", ("",)) == ("", "odom")


def test_the_router_has_a_usual_port():
    assert BusConfig().router_endpoints == ("tcp/127.0.0.1:7447",)
    assert BusConfig(connect=("tcp://127.0.0.1:1",)).router_endpoints == ("tcp/127.0.0.1:1",)
    assert BusConfig(zenoh_config=Path("zenoh.json5")).router_endpoints is None
    assert BusConfig(keys=Folder("keys")).router_endpoints == ("tls/127.0.0.1:7447",)


@pytest.mark.parametrize(
    ("namespace", "name", "expected"),
    [(None, "one", "one"), ("a/b", "one", "a/b/one"), ("a", "", "a"), (None, "", None)],
)
def test_a_robots_namespace_is_within_the_runs(namespace, name, expected):
    assert BusConfig(namespace=namespace).within(name).namespace == expected
