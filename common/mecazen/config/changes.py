"""`[[changes]]`: changes of parameters at set times."""

from __future__ import annotations

from typing import Any

import msgspec

from mecazen.schema import NonNegative, Section


class Change(Section):
    """From a time on parameters have other values, as if they had been set then."""

    at_s: NonNegative
    """Simulated time; whole ticks."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Sections, with what changes in them: `set.follower.standoff_m = 1.5`."""
