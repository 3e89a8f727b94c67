"""The kinds of experiments, by their names in experiment files."""

from __future__ import annotations

from typing import Any

from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.report import Kind
from mecazen_experiments.safety import SAFETY

KINDS: dict[str, Kind[Any]] = {
    "following": FOLLOWING,
    "safety": SAFETY,
}
