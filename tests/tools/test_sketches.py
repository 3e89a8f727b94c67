"""Sketches show what the graph has, and are well-formed."""

import re
from xml.etree import ElementTree

import pytest
from mecazen.graph import GRAPH, Graph
from mecazen_tools.sketches import FLOW, SKETCHES, TICK, TICK_STEPS

ROWS = Graph(GRAPH).rows


def passes(topic: str, giver: str, taker: str) -> bool:
    """Return whether a service or node gives a topic that another one takes."""
    gives = any(
        topic in {one.key for one in row.outputs}
        for row in ROWS
        if giver in (row.name, row.part_of)
    )
    takes = any(
        topic in {one.topic.key for one in row.inputs}
        for row in ROWS
        if taker in (row.name, row.part_of)
    )
    return gives and takes


@pytest.mark.parametrize(("giver", "taker", "topics"), [arrow[:3] for arrow in FLOW])
def test_each_arrow_of_the_data_flow_is_one_of_the_graph(giver, taker, topics):
    assert all(passes(topic, giver, taker) for topic in topics)


@pytest.mark.parametrize(("giver", "taker", "topic"), TICK)
def test_each_arrow_of_a_tick_is_one_of_the_graph(giver, taker, topic):
    begin, end = (TICK_STEPS[one][0] if one == "advance" else one for one in (giver, taker))
    assert passes(topic, begin, end)


@pytest.mark.parametrize("name", SKETCHES)
def test_a_sketch_is_an_image_whose_arrows_have_tips(name):
    text = SKETCHES[name]()
    ElementTree.fromstring(text)  # noqa: S314 - our own text
    tips = set(re.findall(r"url\(#(\w+)\)", text))
    assert tips
    assert all(f'id="{tip}"' in text for tip in tips)
