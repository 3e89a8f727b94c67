"""Makes walkers with the configured manners."""

from __future__ import annotations

from collections.abc import Sequence

from mecazen.config import Scenario

from mecazen_people.manners.grid import Grid
from mecazen_people.manners.helbing import Pedestrians
from mecazen_people.manners.planned import Planned
from mecazen_people.manners.walking import Errand, Walkers

ACCELERATION_M_S2 = 3.0
"""Largest acceleration by ORCA and SFM: a body at 1.5 m/s stops in 0.5 s, about a step."""


def make_walkers(scenario: Scenario, errands: Sequence[Errand], seed: int) -> Walkers:
    """Return people on errands in the world of a scenario."""
    crowd, radius = scenario.crowd, scenario.world.person.radius_m
    obstacles = scenario.world.solids
    if crowd.manners == "helbing":
        return Pedestrians(errands, obstacles, radius, seed)
    places = [place for one in errands for place in (one.start[:2], *one.goals)]
    grid = Grid.around(obstacles, places, crowd.inflation_cells)
    return Planned(errands, obstacles, radius, crowd.manners, grid, ACCELERATION_M_S2)
