"""`[[changes]]`: changes of parameters at set times."""

from __future__ import annotations

from typing import Any

import msgspec

from mecazen.schema import NonNegative, Section


class Change(Section):
    """New values of parameters from a time on, as if they had been set at that time."""

    at_s: NonNegative
    """Simulated time of the change; whole ticks."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """New values in their sections: `set.follower.standoff_m = 1.5`."""
