"""Flow control in lockstep: the clock waits for services that need every sample.

A full link drops samples. So a recorder, and a service that the world does not wait for,
acknowledge the samples that they have received. The clock stays at most `TICKS_AHEAD` ticks ahead
of them, and links can queue the samples of that many ticks.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from mecazen import messages as m
from mecazen.bus import Bus
from mecazen.keys import CLOCK, Topic, of_robot
from mecazen.wire import Stamp

EVERY = "every"
"""A liveliness token `<name>/every` means that its holder needs every sample."""
RECORD = "record"
"""Name of the command `mecazen record`, which needs every sample and is in no scenario."""
TICKS_AHEAD = 64
"""Maximum number of ticks by which the clock is ahead of the slowest holder."""
TICKS_APART = 16
"""Number of ticks from one receipt to the next."""

logger = logging.getLogger(__name__)


def receipts(name: str, robot: str = "") -> Topic[m.Clock]:
    """Return the topic on which a service acknowledges samples; `**` does not match it."""
    return of_robot(Topic(f"@receipts/{name}", m.Clock, "until when all is taken"), robot)


class Receipts:
    """Acknowledges samples for a service that needs all of them.

    The bus already has the service's subscriptions. A control period of 0 is unknown [ns].
    """

    def __init__(self, bus: Bus, name: str, robot: str = "", tick_ns: int = 0) -> None:
        self._bus = bus
        self._publisher = bus.publisher(receipts(name, robot))
        self._step_ns = TICKS_APART * tick_ns
        self._told = Stamp(-1, -1, 0)
        bus.declare_alive(f"{name}/{EVERY}", robot)

    def reached(self, stamp: Stamp) -> None:
        """Acknowledge all samples up to a tick; send a receipt only every `TICKS_APART` ticks."""
        if stamp.run != self._told.run or stamp.time_ns >= self._told.time_ns + self._step_ns:
            self._told = stamp
            self._publisher.put(m.Clock(clock=stamp.time), stamp)

    def follow(self) -> None:
        """Acknowledge, at each sample of the clock, the samples that arrived before it."""

        def take(_: m.Clock, stamp: Stamp | None) -> None:
            if stamp is not None:
                self.reached(stamp)

        self._bus.subscribe(CLOCK, take, every=True)


class Pace:
    """Makes the clock wait for services that need every sample, at most `patience_s` for each."""

    def __init__(self, bus: Bus, tick_ns: int, patience_s: float) -> None:
        self._bus, self._tick_ns, self._patience_s = bus, tick_ns, patience_s
        self._run = 0
        self._tick = 0
        self._taken: dict[str, int] = {}
        """The newest acknowledged tick, by service."""
        self._heard: set[str] = set()
        self._ignored: set[str] = set()
        """Services that were silent for too long, until their next receipt."""
        bus.presence.on_change.append(self._note_tokens)

    def begin(self, run: int) -> None:
        """Begin a run."""
        self._run, self._tick = run, 0
        self._taken = dict.fromkeys(self._taken, 0)

    def keep(self, tick: int, is_over: Callable[[], bool] = lambda: False) -> None:
        """Wait before a tick while a service is too far behind, at most `patience_s`.

        The wait also ends once `is_over` returns True, since the tick is no longer wanted.
        """
        self._tick = tick
        end_s = time.monotonic() + self._patience_s
        while (behind := self._behind()) and not is_over():
            left_s = end_s - time.monotonic()
            if left_s <= 0.0:
                self._ignored.update(behind)
                names = ", ".join(sorted(behind))
                logger.warning("msg=%r", f"going on without {names}, silent: samples may be lost")
                return
            self._bus.spin_once(left_s)

    def _behind(self) -> list[str]:
        return [
            name
            for name, taken in self._taken.items()
            if self._tick - taken > TICKS_AHEAD and name not in self._ignored
        ]

    def _note_tokens(self) -> None:
        end = f"/{EVERY}"
        names = {n.removesuffix(end) for n in self._bus.presence.names if n.endswith(end)}
        self._taken = {name: taken for name, taken in self._taken.items() if name in names}
        for name in sorted(names - self._taken.keys()):
            self._taken[name] = self._tick
            self._hear(name)

    def _hear(self, name: str) -> None:
        if name in self._heard:
            return
        self._heard.add(name)
        robot, _, service = name.rpartition("/")

        def take(_: m.Clock, stamp: Stamp | None) -> None:
            if stamp is not None and stamp.run == self._run and name in self._taken:
                self._taken[name] = max(self._taken[name], stamp.time_ns // self._tick_ns)
                self._ignored.discard(name)

        self._bus.subscribe(receipts(service, robot), take)
