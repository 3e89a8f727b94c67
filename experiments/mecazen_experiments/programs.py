"""The programs of studies: what a run does and measures.

A program is a function of a job that returns the columns of its row: numbers, texts, true or
false, or None where there is nothing to measure. Each run returns the same columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from mecazen_experiments import fuzz, limit, mocap, safety, scores
from mecazen_experiments.followbench import program as benchmark

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

Value = bool | int | float | str | None

PROGRAMS: dict[str, Callable[[Job], Mapping[str, Value]]] = {
    "followbench": benchmark.followbench,
    "followbench_rules": benchmark.followbench_rules,
    "following": scores.following,
    "fuzz": fuzz.fuzz,
    "mocap": mocap.mocap,
    "safety": safety.safety,
    "walkers": limit.walkers,
}
"""The programs by their names in studies."""
