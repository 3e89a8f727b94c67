"""The examples in the docstrings of the SDK are true; those of `Simulation`: tests/system."""

import doctest
from types import ModuleType

import pytest
from mecazen import geometry, keys, robots, wire


@pytest.mark.parametrize("module", [geometry, keys, robots, wire])
def test_what_an_example_shows_is_what_it_gives(module: ModuleType):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
