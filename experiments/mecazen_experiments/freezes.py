"""Services of a simulated run that freeze at random moments, as processes do."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from functools import partial

from mecazen.runtime.host import Service
from mecazen.runtime.schedule import Schedule
from mecazen_tools.simulation import Simulation

BETWEEN_S = (0.5, 4.0)
"""Shortest and longest time from the end of a freeze to the next [s]."""
FROZEN_S = (0.05, 2.0)
"""Shortest and longest freeze [s]."""


def freeze(sim: Simulation, seed: int) -> None:
    """Freeze random services of a run, one at a time, except the service of the world.

    A frozen service takes no turn, and the run continues without it, as in real time.
    """
    chance = random.Random(seed)  # noqa: S311
    clock = sim.host.clock
    assert clock is not None  # a clock drives the run
    world = sim.host.service_of(clock)
    services = [service for service in sim.host.services if service is not world]
    time, begin_s = sim.scenario.sim, 0.0
    while (begin_s := begin_s + chance.uniform(*BETWEEN_S)) < time.duration_s:
        end_s = begin_s + chance.uniform(*FROZEN_S)
        window = range(round(begin_s / time.tick_s), round(end_s / time.tick_s))
        _freeze(chance.choice(services), window)
        begin_s = end_s
    sim.host.revise = lambda: None  # type: ignore[method-assign]  # frozen services repeat no step
    sim.clock.lockstep = False
    sim.clock.schedule = Schedule(time.tick_s, math.inf)  # each tick is due at once


def _freeze(service: Service, window: range) -> None:
    """Skip the turns of a service in some ticks."""
    for turn in service.turns:
        triggered = partial(_is_triggered, window, turn.is_triggered)
        turn.is_triggered = triggered  # type: ignore[method-assign]


def _is_triggered(window: range, otherwise: Callable[[int], bool], tick: int) -> bool:
    return tick not in window and otherwise(tick)
