"""When and why the followed person was not seen, from the tracking states of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby

TrackingRow = tuple[float, str, str]
"""Time [s], tracking state and reason of a `follower/state`."""
LOST = ("lost", "searching")
"""The states in which the robot no longer follows the prediction."""
NAMED = 3
"""Maximum number of reasons in a sentence."""


def spans(rows: Sequence[TrackingRow]) -> list[tuple[float, float, str]]:
    """Return begin and end [s] of the times in which the person is "coasting" or "lost"."""
    groups = [(state, [row[0] for row in group]) for state, group in groupby(rows, _shade)]
    ends_s = [times_s[0] for _, times_s in groups[1:]] + [row[0] for row in rows[-1:]]
    return [
        (times_s[0], end_s, state)
        for (state, times_s), end_s in zip(groups, ends_s, strict=True)
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
