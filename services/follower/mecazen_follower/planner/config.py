"""The planner's part of the follower's section of a scenario."""

from __future__ import annotations

from typing import Annotated

import msgspec
from mecazen.schema import Live, Positive, Section

PRIORITIES = ("distance", "visibility", "bearing", "heading")


class PlannerConfig(Section):
    """The way round obstacles and people that the lidar sees."""

    rate_hz: Positive = 20.0
    """Plans a second; divides the tick rate."""
    samples: Annotated[int, msgspec.Meta(ge=100, le=20_000)] = 1000
    horizon_s: Annotated[float, msgspec.Meta(ge=0.5, le=5.0)] = 2.5
    """How far it looks ahead."""
    clearance_m: Live[Positive] = 0.12
    """To be kept between the robot and everything else."""
    priorities: Live[tuple[str, ...]] = PRIORITIES
    """What of the place beside the person is given up last comes first."""

    def __post_init__(self) -> None:
        if sorted(self.priorities) != sorted(PRIORITIES):
            raise ValueError(f"priorities must be {', '.join(PRIORITIES)}, each once, in any order")

    @property
    def turns_to_see(self) -> bool:
        """Whether the heading is given up to see the person."""
        return self.priorities.index("visibility") < self.priorities.index("heading")
