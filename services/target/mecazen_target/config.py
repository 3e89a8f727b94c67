"""The person's section of a scenario: `[target]`, `[target.path]`, `[target.gait]`."""

from __future__ import annotations

from mecazen.schema import Section
from mecazen_people.config import Body, Driven, Gait, UTrack, Walk


class TargetConfig(Section):
    """The person."""

    path: Walk | Driven = UTrack()
    """Where the person walks; `kind` selects the struct."""
    gait: Gait | None = None
    body: Body = Body()
