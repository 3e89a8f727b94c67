"""Draws the runs of a recording as the viewer draws live ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple, Protocol, cast

import rerun as rr
import rerun.blueprint as rrb
from mecazen.bus import LocalBus
from mecazen.config import Scenario
from mecazen.description import RobotDescription, serve_description
from mecazen.errors import ConfigError, MecazenError
from mecazen.wire import NS_PER_S, RefusedError, Stamp

from mecazen_viewer.layout import blueprint
from mecazen_viewer.service import FRAME_S, ViewerService

FRAME_NS = round(FRAME_S * NS_PER_S)
SECTIONS = ("physics", "follower")
"""Of a scenario: what stands in the world, and where the robot should be."""


class Sample(Protocol):
    """What was published on a key."""

    key: str
    time_ns: int
    stamp: Stamp | None

    def as_published(self) -> tuple[bytes, str, bytes | None]:
        """Return payload, encoding and attachment."""


class Recording(Protocol):
    """What a class under the entry points `mecazen.recordings` reads of a file."""

    def samples(self) -> Iterator[Sample]:
        """Return the samples in the order of recording."""

    def descriptions(self) -> dict[str, RobotDescription]:
        """Return what robots look like, by their names."""

    def scenario(self, run: int, *sections: str) -> Scenario:
        """Return the configuration of a run, with some sections of services."""


def draw(file: Path, folder: Path) -> list[Path]:
    """Draw a recording of `mecazen record` into files for Rerun, one for each run.

    Raises:
        MecazenError: It is another file, or it is not known how it was simulated.
    """
    recording = _reader(file)(file)
    bus = LocalBus()
    for robot, description in recording.descriptions().items():
        serve_description(bus.namespaced(robot), description)
    files: list[Path] = []
    viewer: ViewerService | None = None
    for sample in _frames(recording.samples()):
        if viewer is None:
            if sample.stamp is None:
                continue  # before there is a run
            scenario = recording.scenario(sample.stamp.run, *SECTIONS)
            viewer = ViewerService("viewer", bus, scenario)
            viewer.send = _Saver(folder, files, blueprint(scenario.names)).take
        try:
            bus.put_bytes(sample.key, *sample.as_published())
        except RefusedError:
            continue
        bus.spin()
    if viewer is None:
        raise ConfigError(f"{file}: holds no run")
    viewer.end()
    return files


def _reader(file: Path) -> Callable[[Path], Recording]:
    for entry in entry_points(group="mecazen.recordings"):
        if f".{entry.name}" == file.suffix:
            return cast(Callable[[Path], Recording], entry.load())
    raise MecazenError(f"{file}: the reader of {file.suffix} is not installed")


class _Frame(NamedTuple):
    run: int
    time_ns: int


def _frames(samples: Iterator[Sample]) -> Iterator[Sample]:
    """Return of each key as many samples as the viewer takes of a live run."""
    shown: dict[str, _Frame] = {}
    for sample in samples:
        run = -1 if sample.stamp is None else sample.stamp.run
        last = shown.get(sample.key)
        if last is None or last.run != run or sample.time_ns - last.time_ns >= FRAME_NS:
            shown[sample.key] = _Frame(run, sample.time_ns)
            yield sample


class _Saver:
    """Has each recording written to a file of its own."""

    def __init__(self, folder: Path, files: list[Path], layout: rrb.Blueprint) -> None:
        self._folder, self._files, self._layout = folder, files, layout

    def take(self, recording: rr.RecordingStream) -> None:
        file = self._folder / f"{len(self._files)}.rrd"
        self._files.append(file)
        recording.save(file, default_blueprint=self._layout)
