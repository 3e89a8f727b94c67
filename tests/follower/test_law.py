"""The polar law over several goals, against the velocities by hand."""

import math

import numpy as np
import pytest
from mecazen.config.follower import PolarControl
from mecazen_follower.planner.law import Goals, towards

LAW = PolarControl(heading_gain_1_s=4.0)
BEHIND = -1.0, 0.0, 0.0


def commanded(place, velocity=(0.0, 0.0, 0.0), turn=0.0):
    """Return what is commanded at a place; the goal is 1 m behind a person at the origin."""
    poses, velocities = (np.array(of)[None, :, None] for of in (BEHIND, velocity))
    command = towards(np.zeros((1, 3)), Goals(poses, velocities, np.array([turn])), LAW)
    return command(0, *np.array(place)[:, None])[:, 0]


@pytest.mark.parametrize(
    ("place", "command"),
    [
        (BEHIND, (0.0, 0.0, 0.0)),
        ((-1.1, 0.0, 0.0), (0.3, 0.0, 0.0)),
        ((-5.0, 0.0, 0.0), (4.0, 0.0, 0.0)),  # v² = 2 * 2 m/s² * 4 m
        ((0.0, -1.0, 0.0), (-math.sqrt(2.0 * math.pi), 0.0, 0.0)),  # a quarter of a circle
        ((-1.0, 0.0, -0.1), (0.0, 0.0, 0.4)),
        ((-1.0, 0.0, 2.0), (0.0, 0.0, -3.0)),
        ((-1.0, 0.0, math.tau + 0.1), (0.0, 0.0, -0.4)),
    ],
)
def test_a_resting_goal_is_approached_along_the_circle_and_its_radius(place, command):
    assert commanded(place) == pytest.approx(command, abs=1e-12)


@pytest.mark.parametrize(
    ("velocity", "turn"), [((0.5, 0.2, 0.0), 0.0), ((0.0, -0.5, 0.5), 0.5)], ids=["walks", "turns"]
)
def test_at_the_goal_it_moves_with_the_goal(velocity, turn):
    assert commanded(BEHIND, velocity, turn) == pytest.approx(velocity)
