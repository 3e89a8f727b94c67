"""The recorder: everything that is published, into an MCAP file."""

from __future__ import annotations

import time

from mecazen import keys
from mecazen.bus import Bus, StoppedError
from mecazen.config import Scenario
from mecazen.loading import to_toml
from mecazen.messages import Clock
from mecazen.service import Service
from mecazen.wire import Stamp

from mecazen_recorder.config import RecorderConfig
from mecazen_recorder.recorder import Recorder

LINGER_S = 1.0
"""At the end, what others still send is taken for at most so long ..."""
QUIET_S = 0.1
"""... and until nothing has come for so long."""


class RecorderService(Service):
    """Records beside the services of a scenario: it takes everything and answers nothing."""

    NAME = "recorder"

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        config = scenario.section(RecorderConfig, self.NAME)
        self.recorder = Recorder(bus, config, scenario.services, lambda: to_toml(scenario))
        super().__init__(bus, scenario)
        self.subscribe(keys.CLOCK, self.on_clock)

    def reset(self, seed: int) -> None:
        """Go on: a file holds every run."""
        del seed

    def run(self) -> None:
        """Record until the bus is stopped."""
        self.recorder.run()

    def on_clock(self, clock: Clock, stamp: Stamp | None) -> None:
        """Do nothing: the base class tells the time by it."""

    def close(self) -> None:
        """Take what is still on its way from those that end with this service; end the file."""
        end = time.monotonic() + LINGER_S
        try:
            while time.monotonic() < end and self.bus.spin_once(QUIET_S):
                pass
        except StoppedError:
            pass  # asked a second time: at once, then
        finally:
            self.recorder.close()

    def diagnostics(self) -> dict[str, object]:
        """Return how many samples were recorded; the dropped are counted with the refused."""
        return {"recorded": self.recorder.writer.count}
