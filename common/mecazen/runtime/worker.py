"""Workers: drivers of the services in a process that does not own simulated time."""

from __future__ import annotations

import time
from collections.abc import Iterator

from mecazen.loop import Slot
from mecazen.robots import join_key
from mecazen.runtime.host import Host
from mecazen.runtime.pace import Receipts
from mecazen.wire import Stamp

POLL_S = 0.25
"""Time without a sample after which a wait in lockstep looks at the clock [s]."""


class _RunEnded(Exception):  # noqa: N818 - no error: it ends the tick in progress
    """A sample of a new run has arrived."""


class Worker:
    """Drives the loop of services by the samples that arrive.

    In lockstep a tick waits until all its samples have arrived. In real time it waits until a
    sample of the next tick arrives, and then continues without the missing ones.
    """

    def __init__(self, host: Host) -> None:
        self.host = host
        self._last = -1
        """The newest tick begun in this run."""
        self._lacking: Iterator[Slot] | None = None
        """The tick in progress, which yields slots that lack a sample."""
        self._slot: Slot | None = None
        """The slot that the tick in progress waits for."""
        # turns that only turns of this process trigger are due together with them
        self._turns = [
            (runner.turn.period, slots)
            for runner in host.loop.runners
            if (slots := [slot for slot in runner.triggers if slot.is_remote])
        ]

    def run(self) -> None:
        """Make ticks until the bus is stopped."""
        host = self.host
        names = {join_key(*part) for part in host.parts}
        if not self.host.lockstep or names & host.plan.awaited():
            while True:
                self.step()
        receipts = Receipts(host.bus, *host.parts[0], host.tick_ns)
        while True:
            if self.step() and self._lacking is None:
                # nothing is due before the next turn
                taken = self._due()[0] - 1 if self._last >= 0 else 0
                receipts.reached(host.stamp._replace(time_ns=taken * host.tick_ns))

    def step(self) -> bool:
        """Make a tick or begin a run; return False if an awaited sample can't arrive any more.

        That happens on a bus within one process. A later call continues where this one ended.
        """
        try:
            return self._make_tick()
        except _RunEnded:
            assert self.host.next_run is not None
            self._last, self._lacking = -1, None
            self.host.begin(self.host.next_run)
            self.host.report_if_due()
            return True

    def _make_tick(self) -> bool:
        host = self.host
        if self._lacking is None:
            while (trigger := self._trigger()) is None:
                if not self._wait():
                    host.revise()
                    return False
                host.revise()
            k, stamp = trigger
            while not host.knows(stamp):
                if any(later.revision < stamp.revision for _, later in self._later(k)):
                    self._last = k  # the sample is invalid: a later one has fewer changes
                    return True
                if not self._wait():
                    return False
            self._last, host.stamp = k, stamp
            host.report_if_due()
            self._lacking = host.loop.step(k, stamp)
            self._slot = next(self._lacking, None)
        while self._slot is not None:
            if not self._await(self._slot):
                return False
            self._slot = next(self._lacking, None)
        self._lacking = None
        host.has_news = True  # a command may have arrived after the turn that uses it
        host.revise()
        return True

    def _await(self, slot: Slot) -> bool:
        """Wait for a sample that the tick in progress lacks; return False if it can't arrive."""
        host, begin_s = self.host, time.monotonic()
        while slot.lacks and not self._is_over(self._last):
            if self._wait(POLL_S):
                continue
            if host.bus.hears_itself:
                return False
            if host.lockstep and time.monotonic() - begin_s > host.patience_s(slot):
                raise host.silence_of(host.givers([slot]))
        return True

    def _wait(self, timeout_s: float | None = None) -> bool:
        """Deliver one sample, query or event; return False if none arrives."""
        has_come = self.host.bus.spin_once(timeout_s)
        if self.host.next_run is not None:
            raise _RunEnded
        return has_come

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
            for period, slots in self._turns:
                if k % period == 0:
                    return k, slots
            k += 1

    def _later(self, k: int) -> Iterator[tuple[int, Stamp]]:
        """Yield the first trigger after tick `k` that has arrived on each input."""
        for _, slots in self._turns:
            for slot in slots:
                for stamp, tick, _ in slot.waiting:
                    if tick > k:
                        yield tick, stamp
                        break

    def _is_over(self, k: int) -> bool:
        """Return whether tick `k` stops waiting: in real time, once a later one is triggered."""
        return not self.host.lockstep and next(self._later(k), None) is not None
