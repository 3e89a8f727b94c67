"""A sampler of constant velocities: all twists, each for the whole horizon."""

import numpy as np
import pytest
from mecazen_experiments.sampler import DIRECTIONS, SPEEDS_M_S, TURNS_RAD_S, twists
from mecazen_follower.planner.mppi import STEPS


def test_each_twist_lasts_for_the_whole_horizon():
    commands = twists()
    assert commands.shape == (STEPS, 3, len(SPEEDS_M_S) * DIRECTIONS * len(TURNS_RAD_S))
    assert (commands == commands[0]).all()
    x, y, turn = commands[0]
    assert np.unique(np.hypot(x, y).round(4)) == pytest.approx(SPEEDS_M_S)
    assert np.unique(turn) == pytest.approx(TURNS_RAD_S)
    fastest = np.hypot(x, y) > 1.2
    headings = np.degrees(np.arctan2(y[fastest], x[fastest])) % 360.0
    assert len(set(headings.round(2).tolist())) == DIRECTIONS
