"""A walk at each stage of its estimation: joints, events and strides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX, SIDES
from mecazen_tools.table import Floats

from mecazen_experiments.capture import SEEN, Motion
from mecazen_experiments.gait.events import Events, planted, zeni
from mecazen_experiments.gait.parameters import Gait, Stride, strides, summary
from mecazen_experiments.gait.path import about_path
from mecazen_experiments.gait.rhythm import rhythm
from mecazen_experiments.refine import refine, smooth

LEGS = [[INDEX[f"{s}_{name}"] for name in ("knee", "ankle", "heel", "foot")] for s in SIDES]
"""Joints that a leg's strides need."""


class Stage(NamedTuple):
    """A walk in one of the stages `truth`, `raw`, `filtered` and `refined`."""

    t: Floats
    """Times (n,) [s], at a constant rate."""
    joints: Floats
    """Joints (n, 20, 3) [m] in a level frame; raw joints are NaN in frames without a reported
    body."""
    events: Events | None = None
    """Events; None if none can be found."""
    strides: tuple[Stride, ...] = ()

    @property
    def gait(self) -> Gait | None:
        """The parameters; None without a stride of each side."""
        return summary(self.strides)


def true_stage(truth: Motion) -> Stage:
    """Return the truth, with the events of the planted feet."""
    events = planted(truth.t, truth.joints)
    found = strides(truth.t, truth.joints, events)
    return Stage(truth.t, truth.joints, events, tuple(found))


def seen_stages(seen: Motion) -> dict[str, Stage]:
    """Return the stages of a walk from a tracker's reports; a stage is missing if nothing remains.

    `raw` has the reported joints, with the events of `filtered`. `filtered` has no swaps and gaps,
    and is low-passed. `refined` is the result of `refine`. Events are corrected for their mean
    errors, and those of `filtered` follow the rhythm of the strides.
    """
    found = {"raw": Stage(seen.t, seen.joints)}
    legs_seen = np.stack([(seen.confidence[:, leg] == SEEN).all(axis=1) for leg in LEGS], axis=-1)
    for name, joints in (("filtered", smooth(seen)), ("refined", refine(seen))):
        if joints is None:
            continue
        found[name] = Stage(seen.t, joints)
        if (walk := about_path(joints, seen.rate_hz)) is not None:
            events = zeni(seen.t, walk).corrected()
            if name == "filtered":
                events = events.each(rhythm(seen, walk).regular)
            of = tuple(strides(seen.t, joints, events, legs_seen))
            found[name] = Stage(seen.t, joints, events, of)
    if "filtered" in found:
        found["raw"] = found["raw"]._replace(events=found["filtered"].events)
    return found
