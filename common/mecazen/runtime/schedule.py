"""The schedule of ticks on the wall clock."""

from __future__ import annotations

import time

MAX_LAG_S = 1.0
"""Lag beyond which the schedule restarts instead of catching up [s]."""
RTF_WINDOW_S = 1.0
"""Minimum time over which the real-time factor is measured [s]."""


class Schedule:
    """Ticks of `tick_s` simulated seconds at `speed` simulated seconds per wall second.

    Due times are computed from one start time, so small delays do not accumulate.
    """

    def __init__(self, tick_s: float, speed: float) -> None:
        self.speed = speed
        self.rtf = 0.0
        """Real-time factor over about the last second, or since the first tick; 0 before it."""
        self._is_first_window = True
        self._tick_s = tick_s
        self._period_s = tick_s / speed
        self.restart(0)

    def restart(self, tick: int) -> None:
        """Restart the schedule, with `tick` due now."""
        now = time.monotonic()
        self._begin_s, self._begin_tick = now, tick
        self._published_s = now
        self._window_s, self._window_tick = now, tick

    def published(self, tick: int) -> None:
        """Note that the state of `tick` is published."""
        now = time.monotonic()
        self._published_s = now
        elapsed = now - self._window_s
        is_over = elapsed >= RTF_WINDOW_S
        if is_over or (self._is_first_window and elapsed):
            self.rtf = (tick - self._window_tick) * self._tick_s / elapsed
        if is_over:
            self._window_s, self._window_tick, self._is_first_window = now, tick, False
        if now - self._due_s(tick) > MAX_LAG_S:
            self.restart(tick)

    def wait_s(self, tick: int, *, answered: bool) -> float:
        """Return the time to wait before the tick after `tick` [s]; no wait if 0 or less.

        A schedule that is behind continues as soon as the tick is answered, but gives the other
        services at least half a period to answer.
        """
        due_s = self._due_s(tick + 1)
        if not answered:
            due_s = max(due_s, self._published_s + self._period_s / 2)
        return due_s - time.monotonic()

    def _due_s(self, tick: int) -> float:
        return self._begin_s + (tick - self._begin_tick) * self._period_s
