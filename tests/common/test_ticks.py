"""Rates and times of a scenario in whole ticks."""

import math

import pytest
from harness import error_of
from mecazen.errors import ConfigError
from mecazen.ticks import whole_ticks


@pytest.mark.parametrize(
    ("seconds", "tick_s", "ticks"),
    [(0.0, 0.01, 0), (0.01, 0.01, 1), (0.04, 0.01, 4), (0.3, 0.1, 3), (1e5, 0.01, 10**7)],
)
def test_a_multiple_of_the_tick_is_that_many_ticks(seconds, tick_s, ticks):
    assert whole_ticks("sensor.latency_s", seconds, tick_s) == ticks


@pytest.mark.parametrize("seconds", [0.015, 0.001, 1e-12, 0.0333, 1.0001, math.nan, math.inf])
def test_when_a_time_is_no_multiple_of_the_tick_expect_the_key_and_both(seconds):
    text = error_of(ConfigError, lambda: whole_ticks("sensor.latency_s", seconds, 0.01))
    assert text == f"sensor.latency_s: {seconds:.9g} s is not a whole number of ticks of 0.01 s"
