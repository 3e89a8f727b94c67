"""When a tick is due on the wall clock."""

from __future__ import annotations

import time

MAX_LAG_S = 1.0
"""Behind by more than this, the schedule begins anew instead of catching up."""
RTF_WINDOW_S = 1.0


class Schedule:
    """Ticks of `tick_s` simulated seconds at `speed` simulated seconds per wall second.

    Dates are counted from one beginning, so waiting a little too long never adds up.
    """

    def __init__(self, tick_s: float, speed: float) -> None:
        self.speed = speed
        self.rtf = 0.0
        """Real-time factor over the last second or so."""
        self._tick_s = tick_s
        self._period_s = tick_s / speed
        self.restart(0)

    def restart(self, tick: int) -> None:
        """Let `tick` be due now."""
        now = time.monotonic()
        self._begin_s, self._begin_tick = now, tick
        self._published_s = now
        self._window_s, self._window_tick = now, tick

    def published(self, tick: int) -> None:
        """Note that the state of `tick` is out."""
        now = time.monotonic()
        self._published_s = now
        elapsed = now - self._window_s
        if elapsed >= RTF_WINDOW_S:
            self.rtf = (tick - self._window_tick) * self._tick_s / elapsed
            self._window_s, self._window_tick = now, tick
        if now - self._due_s(tick) > MAX_LAG_S:
            self.restart(tick)

    def wait_s(self, tick: int, *, answered: bool) -> float:
        """Return how long to wait before simulating on from `tick`; 0 or less is not at all.

        A schedule that is behind goes on as soon as the tick is answered, but gives the
        others at least half a period to answer.
        """
        due_s = self._due_s(tick + 1)
        if not answered:
            due_s = max(due_s, self._published_s + self._period_s / 2)
        return due_s - time.monotonic()

    def _due_s(self, tick: int) -> float:
        return self._begin_s + (tick - self._begin_tick) * self._period_s
