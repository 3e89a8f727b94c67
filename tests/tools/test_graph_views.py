"""The graph of two nodes as tables."""

from types import SimpleNamespace

from mecazen.graph import Graph
from mecazen.keys import CMD_VEL, DIAGNOSTICS, OBSERVATION, ODOM, SIM_STATE
from mecazen.row import Row, due, every
from mecazen_tools import graph_views

GIVER = Row("wheels", outputs=(ODOM,), calls=(SIM_STATE,), summary="rolls")
TAKER = Row("driver", inputs=(every(ODOM), due(OBSERVATION)), outputs=(CMD_VEL,))
GRAPH = Graph((GIVER, TAKER))


def test_a_rate_is_shown_in_hz():
    scenario = SimpleNamespace(
        sim=SimpleNamespace(tick_s=0.01), sensor=SimpleNamespace(rate_hz=25.0, other_hz=None)
    )
    rates = ("sensor.rate_hz", "sensor.other_hz", "tick", 5.0, "5 Hz", "any")
    shown = [graph_views.in_hz(rate, scenario) for rate in rates]
    assert shown == ["25 Hz", "100 Hz", "100 Hz", "5 Hz", "5 Hz", "any"]


def test_a_node_takes_by_rules_and_gives_topics_and_answers():
    assert graph_views.takes(TAKER) == "odom (every), target/observation (due)"
    assert graph_views.gives(TAKER) == "cmd_vel"
    assert graph_views.gives(GIVER) == "odom, sim/state?"
    assert graph_views.takes(Row("recorder", observes=True)) == "everything"


def test_a_topic_has_the_rate_and_the_source_of_who_gives_it():
    rows = {key: (rate, source) for key, _, rate, source, _ in graph_views.topic_rows(GRAPH)}
    assert rows["odom"] == ("tick", "wheels")
    assert rows["cmd_vel"] == ("tick", "driver or anyone")
    assert rows["target/observation"] == ("any", "anyone")
    assert rows[DIAGNOSTICS.key] == ("1 Hz", "each service")
    ((key, _, _, who, _),) = graph_views.call_rows(GRAPH)
    assert (key, who) == ("sim/state", "wheels")
