"""Model predictive path integral control: the mean of random commands, weighted by their costs.

Williams, Aldrich & Theodorou, Model predictive path integral control: from theory to parallel
computation, J. Guid. Control Dyn. 40(2), 2017. Here each of several nominal paths is sampled
separately, since a mean of paths on both sides of a pillar leads into the pillar. The cheapest path
is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from mecazen.drive import Array
from mecazen.portable import exp

from mecazen_follower.planner.rollout import Rollout

STEPS = 20
KNOTS = 6
"""Number of random values; the noise is piecewise linear between them."""
NOISE = 0.5, 0.5, 0.8
"""Standard deviations of the noise [m/s, m/s, rad/s]."""
FINE = 0.25
"""Factor on the noise of every other sample."""
TEMPERATURE = 0.5
"""Difference of costs by which a sample's weight falls to 1/e."""

LOYALTY = 0.5
"""A path must be cheaper by this cost to replace the last plan."""


class Problem(NamedTuple):
    """The problem for which the search finds a path."""

    nominal: Array
    """Commands of each mode (STEPS, 3, modes)."""
    roll: Callable[[Array], Rollout]
    """Returns the rollout of commands (STEPS, 3, n)."""
    cost: Callable[[Rollout], Array]
    """Returns the costs of paths (n)."""
    loyal: bool
    """Whether the last mode is the last plan, which gets the bonus `LOYALTY`."""


Search = Callable[[Problem], tuple[Rollout, Array]]
"""A search for paths: returns paths (n) and their costs."""


class Mppi:
    """Samples around nominal commands, with the same seeded noise at each plan."""

    def __init__(self, samples: int, seed: int) -> None:
        random = np.random.Generator(np.random.PCG64(seed))
        knots = random.standard_normal((KNOTS, 3, samples)) * np.array(NOISE)[:, None]
        at = np.linspace(0.0, KNOTS - 1.0, STEPS)
        before = np.minimum(at.astype(int), KNOTS - 2)
        share = (at - before)[:, None, None]
        noise = (1.0 - share) * knots[before] + share * knots[before + 1]
        noise[..., 1::2] *= FINE
        self._noise = noise.astype(np.float32)

    def plan(self, problem: Problem) -> tuple[Rollout, Array]:
        """Return each nominal path and the weighted mean path of each mode, and their costs."""
        nominal, roll, cost, loyal = problem
        modes, samples = nominal.shape[-1], self._noise.shape[-1]
        ends = np.arange(modes + 1) * samples // modes
        commands = np.repeat(nominal.astype(np.float32), np.diff(ends), axis=-1)
        commands += self._noise
        ways = roll(commands)
        costs = cost(ways)
        means = np.empty_like(nominal)
        for mode, (begin, end) in enumerate(pairwise(ends.tolist())):
            own = slice(begin, end)
            weights = exp((costs[own].min() - costs[own]) / TEMPERATURE)
            weights /= weights.sum()
            means[..., mode] = np.einsum("kan,n->ka", commands[..., own], weights)
        best = roll(np.concatenate((nominal, means), axis=-1))
        costs = cost(best)
        if loyal:
            costs[[modes - 1, -1]] -= LOYALTY
        return best, costs
