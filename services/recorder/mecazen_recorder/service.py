"""The recorder: everything that is published, into an MCAP file."""

from __future__ import annotations

import logging
import time
from itertools import count
from pathlib import Path

import msgspec
from mecazen import keys
from mecazen.bus import Bus, StoppedError
from mecazen.config import Scenario
from mecazen.loading import to_toml
from mecazen.messages import Clock
from mecazen.runtime.observer import Observer
from mecazen.wire import Stamp

from mecazen_recorder.config import RecorderConfig
from mecazen_recorder.recorder import Recorder

logger = logging.getLogger(__name__)

LINGER_S = 1.0
"""At the end, what others still send is taken for at most so long ..."""
QUIET_S = 0.1
"""... and until nothing has come for so long."""


class RecorderService(Observer):
    """Records beside the services of a scenario: it takes everything and answers nothing."""

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        super().__init__(name, bus, scenario)
        config = scenario.section(RecorderConfig, "recorder")
        if scenario.sim.mode == "real_time":  # it may have been started again
            config = msgspec.structs.replace(config, file=str(free_name(Path(config.file))))
        self.recorder = Recorder(
            bus, config, scenario.services, lambda: to_toml(scenario), scenario.names
        )
        self.subscribe(keys.CLOCK, self.on_clock)

    def reset(self, seed: int) -> None:
        """Go on: a file holds every run."""
        del seed

    def run(self) -> None:
        """Record until the bus is stopped."""
        self.recorder.run()

    def on_clock(self, clock: Clock, stamp: Stamp | None) -> None:
        """Do nothing: the base class knows the newest tick by it."""

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


def free_name(path: Path) -> Path:
    """Return `run.mcap`, or the first of `run-2.mcap`, `run-3.mcap`, … that does not exist."""
    if not path.exists():
        return path
    names = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
    free = next(name for name in names if not name.exists())
    logger.warning("msg=%r", f"{path} exists already; this recording is {free}")
    return free
