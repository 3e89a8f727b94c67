"""Errors of user code in one line, with the place in the user's own files."""

import re

import pytest
from mecazen.errors import BusError, ConfigError, explained
from mecazen.keys import CLOCK
from mecazen.messages import Clock


def fail(*_):
    raise ValueError("two\n  lines")


def test_a_mistake_is_explained_in_one_line_by_the_frames_outside_of_mecazen(bus):
    bus.subscribe(CLOCK, fail)
    with pytest.raises(ValueError, match="two") as caught:
        bus.publisher(CLOCK).put(Clock(), None)  # through a frame of bus/local.py
    here = r"test_errors.py:\d+"
    line = rf"ValueError: two lines \({here} test_a_mistake\w+ > {here} fail\)"
    assert re.fullmatch(line, explained(caught.value))


def test_a_wrong_configuration_ends_with_another_code_than_other_failures():
    assert (ConfigError.exit_code, BusError.exit_code) == (2, 1)
