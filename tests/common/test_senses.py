"""The kind of sensor decides who takes part: services, nodes and what they give."""

import pytest
from mecazen import keys
from mecazen.config import Scenario, SensorConfig
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario
from mecazen.programs import graph_of


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


def test_a_service_that_the_sensor_needs_is_added_to_those_that_are_listed(write_scenario):
    listed = "services = ['physics', 'controller', 'target', 'follower']\n"
    path = write_scenario(f"{listed}sensor.kind = 'fused'\n")
    assert load_scenario(path).services[-2:] == ("sensors", "guard")
    assert load_scenario(path, ("sensor.kind=pose",)).services[-1] == "follower"


def test_a_service_without_a_part_in_the_scenario_is_refused(write_scenario):
    path = write_scenario("services = ['physics', 'controller', 'target', 'sensors']\n")
    with pytest.raises(ConfigError, match="sensors takes no part with"):
        graph_of(load_scenario(path))


def test_robots_of_one_world_have_the_same_kind_of_sensor(write_scenario):
    robots = "[[robots]]\nname = 'a'\nsensor.kind = 'body'\n[[robots]]\nname = 'b'\nstart.x_m = 3\n"
    with pytest.raises(ConfigError, match="are the same for all robots"):
        load_scenario(write_scenario(robots))


def test_the_rate_of_a_sensor_is_known_where_its_service_is_not_installed(write_scenario):
    scenario = load_scenario(write_scenario("sensor.kind = 'fused'\n"))
    assert scenario.ticks_per(graph_of(scenario).rate(keys.LEGS.key)) == 10
    assert scenario.ticks_per(graph_of(scenario).rate(keys.OBSERVATION.key)) == 4
