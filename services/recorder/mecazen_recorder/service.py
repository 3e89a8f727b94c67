"""The recorder: writes all published samples to an MCAP file."""

from __future__ import annotations

import logging
import time
from functools import partial
from itertools import count
from pathlib import Path

import msgspec
from mecazen import keys
from mecazen.bus import Bus, StoppedError
from mecazen.config import Scenario
from mecazen.loading import to_toml
from mecazen.programs import graph_of
from mecazen.runtime.observer import Observer
from mecazen.runtime.pace import declare_every

from mecazen_recorder.recorder import Recorder

logger = logging.getLogger(__name__)

LINGER_S = 3.0
"""At the end, samples are recorded for at most this long ..."""
QUIET_S = 0.3
"""... or until none has come for this long."""


class RecorderService(Observer):
    """Records the services of a scenario."""

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        super().__init__(name, bus, scenario)
        config = scenario.recorder
        if scenario.sim.mode == "real_time":  # the service may have been restarted
            config = msgspec.structs.replace(config, file=free_name(config.path))
        parts, topics = scenario.services, graph_of(scenario).topics
        toml = partial(to_toml, scenario)
        self.recorder = Recorder(bus, config, parts, toml, scenario.names, topics)
        self.subscribe(keys.CLOCK, lambda *_: None)  # the base class notes the newest tick

    def reset(self, seed: int) -> None:
        """Continue: one file holds every run."""
        del seed

    def run(self) -> None:
        """Record until the bus is stopped."""
        if self.scenario.sim.mode == "lockstep":
            declare_every(self.bus, self.name)
        self.recorder.run()

    def close(self) -> None:
        """Record the samples that are still in transit, and finish the file."""
        end = time.monotonic() + LINGER_S
        try:
            while time.monotonic() < end and self.bus.spin_once(QUIET_S):
                pass
        except StoppedError:
            pass  # stopped a second time: finish at once
        finally:
            self.recorder.close()

    def diagnostics(self) -> dict[str, object]:
        """Return the number of recorded samples; dropped ones count as refused."""
        return {"recorded": self.recorder.writer.count}


def free_name(path: Path) -> Path:
    """Return `run.mcap`, or the first of `run-2.mcap`, `run-3.mcap`, … that does not exist."""
    if not path.exists():
        return path
    names = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
    free = next(name for name in names if not name.exists())
    logger.warning("msg=%r", f"{path} exists already; this recording is {free}")
    return free
