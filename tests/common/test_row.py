"""A node's row: what makes sense in it, and how it changes with its place."""

import pytest
from mecazen import keys
from mecazen.errors import ConfigError
from mecazen.graph import TABLE
from mecazen.keys import CMD_VEL, ODOM
from mecazen.row import Row, every, latest


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"inputs": every(keys.ODOM)}, "inputs must be a tuple, each Input"),
        ({"inputs": (keys.ODOM,)}, "inputs must be a tuple, each Input"),
        ({"outputs": ("odom",)}, "outputs must be a tuple, each Topic"),
        ({"inputs": (every(keys.ODOM), latest(keys.ODOM))}, "inputs: each topic at most once"),
        ({"outputs": (keys.ODOM, keys.ODOM)}, "outputs: each topic at most once"),
        ({"rates": {"odom": 10.0}}, "rates: 'odom' is no key of its outputs"),
        ({"outputs": (keys.ODOM,), "rates": {"odom": 0}}, "rates: odom must be positive"),
    ],
)
def test_a_row_that_makes_no_sense_is_refused(fields, expected):
    with pytest.raises(ConfigError, match=f"^row mine: {expected}"):
        Row("mine", **fields)


def test_an_input_needs_a_topic():
    with pytest.raises(ConfigError, match=r"^every\('odom'\): needs a topic, such as mecazen\."):
        every("odom")


def test_what_takes_a_place_keeps_its_own_inputs_and_outputs_and_gets_the_rest():
    mine = Row("mine", inputs=(latest(ODOM),), outputs=(CMD_VEL,), priority=50, shared=True)
    placed = mine.placed(TABLE["follower"])
    assert (placed.name, placed.part_of, placed.priority) == ("follower", "follower", 2)
    assert (placed.inputs, placed.outputs) == (mine.inputs, mine.outputs)
    assert not placed.shared
