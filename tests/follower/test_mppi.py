"""The search by random commands, for ways that are their own commands."""

import numpy as np
import pytest
from mecazen_follower.planner.mppi import LOYALTY, STEPS, Mppi, Problem
from mecazen_follower.planner.rollout import Rollout

AT_REST = np.zeros((STEPS, 3, 2))
"""Two modes."""


def as_they_are(commands):
    x, y, yaw = commands.swapaxes(0, 1)
    return Rollout(x, y, yaw, yaw, commands)


def plan(cost, loyal=False, seed=1):
    return Mppi(400, seed).plan(Problem(AT_REST, as_they_are, cost, loyal))


def off(ways):
    """Return the cost of ways that should go ahead with 0.3 m/s."""
    return ((ways.x - 0.3) ** 2).sum(axis=0)


def test_the_mean_of_the_cheap_samples_is_cheaper_than_what_they_are_drawn_about():
    ways, costs = plan(off)
    assert ways.x.shape == (STEPS, 4)
    assert (ways.commands[..., :2] == AT_REST).all()
    assert costs[:2] == pytest.approx([0.09 * STEPS] * 2)
    assert (costs[2:] < costs[:2]).all()
    assert (costs == off(ways)).all()


def test_the_same_seed_gives_the_same_ways_and_another_one_others():
    (first, _), (again, _), (other, _) = plan(off), plan(off), plan(off, seed=2)
    assert (first.commands == again.commands).all()
    assert (first.commands != other.commands).any()


def test_the_last_mode_is_kept_to_unless_another_one_is_much_cheaper():
    _, costs = plan(lambda ways: np.zeros(ways.x.shape[-1]), loyal=True)
    assert costs.tolist() == [0.0, -LOYALTY, 0.0, -LOYALTY]
