"""`[sim]`: simulated time."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from mecazen.schema import Positive, Section


class SimConfig(Section):
    """Simulated time."""

    mode: Literal["real_time", "lockstep"] = "real_time"
    """real_time follows the wall clock; lockstep waits for every answer, not for the wall clock."""
    tick_s: Annotated[float, msgspec.Meta(ge=0.001, le=1.0)] = 0.01
    """The control period; whole nanoseconds."""
    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0
    """Simulated seconds per wall second in real time."""
    duration_s: Positive = 60.0
    """Length of a lockstep run; a real-time run ends when it is stopped."""
    answer_timeout_s: Positive = 10.0
    """Wall time after which a service that does not answer a tick in lockstep is an error."""

    @property
    def tick_ns(self) -> int:
        """The control period [ns]."""
        return round(self.tick_s * 1e9)

    @property
    def ticks(self) -> int:
        """Ticks of a lockstep run."""
        return round(self.duration_s / self.tick_s)
