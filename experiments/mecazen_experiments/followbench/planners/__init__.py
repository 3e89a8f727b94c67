"""Planners that follow the target of an episode: they map a view to a speed and a yaw rate."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mecazen_experiments.followbench.planners.ours import Ours
from mecazen_experiments.followbench.planners.proportional import Proportional
from mecazen_experiments.followbench.planners.social import Social
from mecazen_experiments.followbench.planners.window import Window
from mecazen_experiments.followbench.view import Planner

PLANNERS: dict[str, Callable[[], Planner]] = {
    "ours": Ours,
    "social": Social,
    "window": Window,
    "proportional": partial(Proportional, brakes=False),
    "braking": partial(Proportional, brakes=True),
}
"""Makers of the planners by their names."""
