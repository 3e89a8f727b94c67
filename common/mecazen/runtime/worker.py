"""Workers: drivers of the services in a process that does not own simulated time."""

from __future__ import annotations

import time
from collections.abc import Iterator

from mecazen.loop import Slot
from mecazen.runtime.host import Host
from mecazen.runtime.pace import announce_every
from mecazen.wire import Stamp

POLL_S = 0.25
"""Time without a sample after which a wait in lockstep looks at the clock [s]."""


class Worker:
    """Drives the loop of services by the samples that arrive.

    In lockstep a tick waits until all its samples have arrived. In real time it waits until a
    sample of the next tick arrives, and then continues without the missing ones.
    """

    def __init__(self, host: Host) -> None:
        self.host = host
        self._last = -1
        """The newest tick begun in this run."""
        self._is_in_tick = False
        """Whether that tick has not ended."""
        # turns that only turns of this process trigger are due together with them
        self._triggers = [
            (turn.period, slots)
            for turn in host.loop.turns
            if (slots := [slot for slot in turn.triggers if slot.is_remote])
        ]

    def run(self) -> None:
        """Make ticks until the bus is stopped."""
        host = self.host
        if host.lockstep and not host.is_awaited():
            announce_every(host.bus, *host.parts[0])
        while True:
            self.step()

    def step(self) -> bool:
        """Make a tick or begin a run.

        Returns:
            False if an awaited sample can't arrive any more, on a bus within one process. A later
            call continues where this one ended.
        """
        host = self.host
        is_done = self._make_tick()
        if host.next_run is None:
            return is_done
        self._last, self._is_in_tick = -1, False
        host.begin(host.next_run)
        host.report_if_due()
        return True

    def _make_tick(self) -> bool:
        """Make the next tick; return False if it can't end, or a new run has to begin."""
        host = self.host
        if not self._is_in_tick:
            while (trigger := self._trigger()) is None:
                has_come = host.bus.spin_once()
                host.revise()
                if not has_come or host.next_run is not None:
                    return False
            self._last, host.stamp = trigger
            self._is_in_tick = True
            host.apply_changes(host.stamp)
            host.report_if_due()
        if not host.loop.step(self._last, host.stamp, self._await):
            return False
        self._is_in_tick = False
        host.has_news = True  # a command may have arrived after the turn that uses it
        host.revise()
        return True

    def _await(self, slot: Slot) -> bool:
        """Wait for a sample that the tick in progress lacks; return False if it can't arrive."""
        host, begin_s = self.host, time.monotonic()
        while slot.is_missing and not self._is_over(self._last):
            has_come = host.bus.spin_once(POLL_S)
            if host.next_run is not None or (host.bus.hears_itself and not has_come):
                return False
            if has_come or not host.lockstep:
                continue
            if time.monotonic() - begin_s > host.patience_s(slot):
                raise host.silence_of(host.givers([slot]))
        return True

    def _trigger(self) -> tuple[int, Stamp] | None:
        """Return the tick to make and its stamp, if a sample that triggers it has arrived."""
        if not self.host.lockstep or self._last < 0:
            return min(self._later(self._last), default=None)
        k, slots = self._due()
        for stamp, tick, _ in slots[0].waiting:
            if tick >= k:  # if it is later, no sample of this tick will arrive
                return (k, stamp) if tick == k else min(self._later(self._last))
        return None

    def _due(self) -> tuple[int, list[Slot]]:
        """Return the next tick in which a turn is due, and the slots that trigger this turn."""
        k = self._last + 1
        while True:
            for period, slots in self._triggers:
                if k % period == 0:
                    return k, slots
            k += 1

    def _later(self, k: int) -> Iterator[tuple[int, Stamp]]:
        """Yield the first trigger after tick `k` that has arrived on each input."""
        for _, slots in self._triggers:
            for slot in slots:
                for stamp, tick, _ in slot.waiting:
                    if tick > k:
                        yield tick, stamp
                        break

    def _is_over(self, k: int) -> bool:
        """Return whether tick `k` stops waiting: in real time, once a later one is triggered."""
        return not self.host.lockstep and next(self._later(k), None) is not None
