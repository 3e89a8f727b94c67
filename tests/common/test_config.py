"""The sections of a scenario: their defaults, and what they compute."""

import math
from pathlib import Path

import msgspec
import pytest
from common.sections import problem
from mecazen.config import BusConfig, ControllerConfig, SensorsConfig, SimConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.schema import Folder

WALKERS = "[{path={kind='standing',x_m=3.0},body={shuffle={}}}]"


def test_times_of_a_run_are_in_whole_ticks(scenario):
    assert scenario.sim.tick_ns == 10_000_000
    assert scenario.sim.ticks == 6000
    assert scenario.sensor.ticks_per_frame(scenario.sim.tick_s) == 4


def test_the_start_is_in_degrees(write_scenario):
    loaded = load_scenario(write_scenario("[start]\nx_m = 1.0\ny_m = -2.0\nyaw_deg = 90.0"))
    assert loaded.start.pose == Pose2D(1.0, -2.0, math.pi / 2)


def test_processes_meet_at_the_usual_port_unless_something_else_is_said():
    assert BusConfig().router_endpoints == ("tcp/127.0.0.1:7447",)
    assert BusConfig(connect=("tcp/127.0.0.1:1",)).router_endpoints == ("tcp/127.0.0.1:1",)
    assert BusConfig(zenoh_config=Path("zenoh.json5")).router_endpoints is None
    assert BusConfig(keys=Folder("keys")).router_endpoints == ("tls/127.0.0.1:7447",)


@pytest.mark.parametrize("setting", ["target.body.limp={}", f"crowd.walkers={WALKERS}"])
def test_a_body_that_no_sensor_sees_is_refused(write_scenario, setting):
    path = write_scenario()
    assert "no sensor sees how a body walks; sensor.kind = 'body'" in problem(path, setting)
    assert load_scenario(path, parse_settings((setting, 'sensor.also=["lidar"]')))


def test_a_robots_namespace_is_within_that_of_the_run():
    assert BusConfig().within("one").namespace == "one"
    assert BusConfig(namespace="a/b").within("one").namespace == "a/b/one"
    assert BusConfig(namespace="a").within("").namespace == "a"
    assert BusConfig().within("").namespace is None


def test_rates_are_whole_ticks_of_the_scenario(scenario):
    controller = ControllerConfig(update_rate_hz=20.0)
    scenario = msgspec.structs.replace(scenario, sim=SimConfig(tick_s=0.005), controller=controller)
    rates = (None, 50.0, "sensor.rate_hz", "controller.update_rate_hz", "controller.half_track_m")
    assert [scenario.ticks_per(rate) for rate in rates] == [1, 4, 8, 10, 1]
    with pytest.raises(ConfigError, match=r"^rate = 300 must divide the tick rate of 200 Hz"):
        scenario.ticks_per(300.0)


def test_a_rate_that_is_no_key_of_the_configuration_is_refused(scenario):
    for key in ("sensor.rate", "sim.mode", "nobody.rate_hz"):
        with pytest.raises(ConfigError, match=rf"^{key}: a node's rate that is no number"):
            scenario.ticks_per(key)


@pytest.mark.parametrize(
    "section",
    [
        {"lidar": {"min_range_m": 2.0, "max_range_m": 1.0}},
        {"tracker": {"max_range_m": 0.4}},
        {"depth": {"edge_probability": 0.6}},
    ],
)
def test_a_setting_of_sensors_out_of_its_range_is_refused(section):
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(section, SensorsConfig)
