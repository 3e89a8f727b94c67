"""The table of nodes: consistent in itself, and what it says of a scenario."""

from collections import Counter
from typing import get_args, get_type_hints

import pytest
from mecazen import keys
from mecazen.config import Scenario, SensorConfig, with_guard
from mecazen.graph import GRAPH, NODES, OBSERVERS, SERVICES, SHARED, Graph, rows, services
from mecazen.keys import CMD_VEL, ODOM
from mecazen.row import Row, every

GRAPH_OF_ALL = Graph(GRAPH)


def test_names_are_unique_and_each_table_of_names_follows():
    counts = Counter((row.part_of, row.name) for row in GRAPH)
    assert set(counts.values()) == {1}
    assert set(SERVICES) == {row.part_of for row in GRAPH}
    assert set(SHARED) == {row.part_of for row in GRAPH if row.shared}
    assert set(OBSERVERS) == {row.part_of for row in GRAPH if row.observes}
    assert set(NODES) == {row.name for row in GRAPH} - {"clock"}


def test_every_input_is_given_by_a_node_or_anyone_may_give_it():
    taken = {i.topic for row in GRAPH for i in row.inputs} - {keys.DIAGNOSTICS}  # of every service
    assert [t.key for t in taken if not (t.open or GRAPH_OF_ALL.giver(t.key))] == []


@pytest.mark.parametrize("kind", get_args(get_type_hints(SensorConfig)["kind"]))
def test_every_awaited_key_of_a_kind_of_sensor_has_one_giver(kind):
    features = with_guard(SensorConfig(kind=kind).features, enabled=True)
    nodes = rows(features)
    givers = Counter(topic for row in nodes for topic in row.outputs)
    awaited = {i.topic for row in nodes for i in row.inputs if i.rule == "every"}
    assert {givers[topic] for topic in awaited} == {1}
    assert max(givers.values()) == 1
    assert givers[keys.OBSERVATION] + givers[keys.LEGS] > 0


def test_every_key_of_the_tables_is_given_or_answered_once():
    given = {topic for row in GRAPH for topic in row.outputs}
    anyone = {keys.EMERGENCY_STOP, keys.TARGET_CMD_VEL, keys.DIAGNOSTICS}
    assert set(keys.TOPICS) - given == anyone
    for left_out in ("physics", "hardware"):  # one of them takes the place of the other
        nodes = [row for row in GRAPH if row.part_of != left_out]
        answered = Counter(call for row in nodes for call in row.calls)
        assert set(answered.values()) == {1}
        assert set(keys.CALLS) - set(answered) <= {keys.STOP_MOTORS, keys.RELEASE_MOTORS}


def test_services_have_nodes_of_one_kind():
    for nodes in services(GRAPH).values():
        assert len({(row.observes, row.priority) for row in nodes}) == 1
        assert len({row.shared for row in nodes if row.name != "motors"}) == 1


def test_rates_are_those_of_outputs_and_refer_to_settings_that_exist():
    sections = get_type_hints(Scenario)
    for row in GRAPH:
        assert set(row.rates) <= {topic.key for topic in row.outputs}
        for rate in row.rates.values():
            section, setting = str(rate).split(".")[:2]
            assert setting in sections[section].__struct_fields__


@pytest.mark.parametrize(
    ("topic", "rate"),
    [
        (keys.JOINT_STATES, None),
        (keys.JOINT_COMMAND, None),
        (ODOM, "controller.update_rate_hz"),
        (CMD_VEL, "controller.update_rate_hz"),  # that of the odometry, by which it comes
        (keys.OBSERVATION, "sensor.rate_hz"),
        (keys.TARGET_CMD_VEL, None),  # no node's
    ],
)
def test_a_topic_comes_at_the_rate_of_its_row_or_of_its_givers_inputs(topic, rate):
    assert GRAPH_OF_ALL.rate(topic.key) == rate


def test_a_graph_that_goes_in_circles_has_rates():
    one = Row("one", inputs=(every(ODOM),), outputs=(CMD_VEL,))
    assert Graph((one, Row("two", (), (every(CMD_VEL),), (ODOM,)))).rate(ODOM.key) is None
    timed = Row("two", inputs=(every(CMD_VEL),), outputs=(ODOM,), rates={ODOM.key: 20.0})
    assert Graph((one, timed)).rate(CMD_VEL.key) == 20.0
