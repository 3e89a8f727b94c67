"""`[target]`: the person whom the robot follows."""

from __future__ import annotations

from mecazen.config.people import Body, Driven, Gait, Goal, UTrack, Walk
from mecazen.schema import Section


class TargetConfig(Section):
    """The person."""

    path: Walk | Driven | Goal = UTrack()
    """Where the person walks; `kind` selects the struct."""
    gait: Gait | None = None
    body: Body = Body()
