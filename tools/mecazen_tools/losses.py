"""When and why the followed person was not seen, from the tracking states of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

TrackingRow = tuple[float, str, str]
"""Time [s], tracking state and reason of a `follower/state`."""
LOST = ("lost", "searching")
"""The states in which the robot no longer follows the prediction."""
NAMED = 3
"""Maximum number of reasons in a sentence."""


class Span(NamedTuple):
    """A time in which the person is not seen."""

    begin_s: float
    end_s: float
    is_lost: bool
    """Whether the person is lost, or the robot still follows the prediction."""


def spans(rows: Sequence[TrackingRow]) -> list[Span]:
    """Return the times in which the person is coasting or lost."""
    groups = [(state, list(group)) for state, group in groupby(rows, _shade)]
    ends_s = [group[0][0] for _, group in groups[1:]] + [row[0] for row in rows[-1:]]
    return [
        Span(group[0][0], end_s, state == "lost")
        for (state, group), end_s in zip(groups, ends_s, strict=True)
        if state
    ]


def _shade(row: TrackingRow) -> str:
    return "lost" if row[1] in LOST else "coasting" if row[1] == "coasting" else ""


def lost_shares(rows: Sequence[TrackingRow]) -> dict[str, float]:
    """Return the share of time in which the person is lost, by reason, the largest first."""
    reasons = Counter(reason for _, state, reason in rows if state in LOST)
    return {reason: count / len(rows) for reason, count in reasons.most_common()}


def sentence(shares: Mapping[str, float]) -> str:
    """Return how long the person was lost and why, from `lost_shares`; empty if never."""
    if not shares:
        return ""
    named = [(reason or "no reason known", f"{share:.0%}") for reason, share in shares.items()]
    reasons = named[0][0] if len(named) == 1 else ", ".join(map(" ".join, named[:NAMED]))
    return f"lost {sum(shares.values()):.0%} of the time: {reasons}"
