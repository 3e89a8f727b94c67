"""A sampler of constant velocities: all twists, each for the whole horizon."""

from types import SimpleNamespace

import numpy as np
import pytest
from mecazen_experiments.sampler import DIRECTIONS, SPEEDS_M_S, TURNS_RAD_S, Window
from mecazen_follower.planner.mppi import STEPS


def test_each_twist_is_driven_for_the_whole_horizon_and_has_its_cost():
    rolled = []
    problem = SimpleNamespace(
        roll=lambda commands: rolled.append(commands) or "ways", cost=lambda ways: f"cost of {ways}"
    )
    assert Window().plan(problem) == ("ways", "cost of ways")
    (commands,) = rolled
    assert commands.shape == (STEPS, 3, len(SPEEDS_M_S) * DIRECTIONS * len(TURNS_RAD_S))
    assert (commands == commands[0]).all()
    x, y, turn = commands[0]
    assert np.unique(np.hypot(x, y).round(4)) == pytest.approx(SPEEDS_M_S)
    assert np.unique(turn) == pytest.approx(TURNS_RAD_S)
    fastest = np.hypot(x, y) > 1.2
    headings = np.degrees(np.arctan2(y[fastest], x[fastest])) % 360.0
    assert len(set(headings.round(2).tolist())) == DIRECTIONS
