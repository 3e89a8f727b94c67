"""Shows recorded runs, with the scene of live ones."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import closing
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from mecazen.bus import LocalBus
from mecazen.errors import ConfigError, MecazenError, is_installed
from mecazen.files import open_regular
from mecazen.urdf import serve_description
from mecazen.wire import RefusedError

from mecazen_viewer.layout import blueprint
from mecazen_viewer.rerun_process import SHOWS, WINDOW, RerunProcess, free_port, page, uri
from mecazen_viewer.service import FRAME_NS, ViewerService
from mecazen_viewer.web import served_page

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of an MCAP file; Rerun shows an empty page for a file without them."""
SECTIONS = ("physics", "follower")
"""Sections of a scenario that the scene needs."""


def open_file(file: Path, *, native: bool) -> None:
    """Show a file until its window is closed or until Ctrl-C.

    Raises:
        ConfigError: The file can't be read, or is not a recording in spite of its name.
        RerunError: Rerun can't show the file here.
    """
    with open_regular(file) as content:
        begin = content.read(len(MAGIC))
    if file.suffix == ".mcap" and begin != MAGIC:
        raise ConfigError(f"{file}: not an MCAP file")
    with TemporaryDirectory(prefix="mecazen-view-") as folder:
        shown = [file]
        if file.suffix == ".mcap":
            try:
                shown = draw(file, Path(folder))
            except MecazenError as error:
                sys.stderr.write(f"{error}; shown without the scene\n")
        try:
            if native:
                with closing(RerunProcess(*WINDOW, *map(str, shown), ready=SHOWS)) as window:
                    window.wait()
                return
            data, web = free_port("data port", 0), free_port("web port", 0)
            with served_page(data, web, *map(str, shown)) as server:
                print(f"{file}: {page(web, uri(data))}\nCtrl-C ends it.", flush=True)
                server.wait()
        except KeyboardInterrupt:
            return


def draw(file: Path, folder: Path) -> list[Path]:
    """Draw a recording of `mecazen record` into files for Rerun, one for each run.

    Raises:
        MecazenError: The file is of another kind, or lacks the configuration of its run.
    """
    if not is_installed("recorder"):
        raise MecazenError(f"{file}: its reader needs pip install 'mecazen[recorder]'")
    recording = import_module("mecazen_recorder.reader").Recording(file)
    bus = LocalBus()
    for robot, description in recording.descriptions().items():
        serve_description(bus, robot, description)
    files: list[Path] = []

    def save(layout: rrb.Blueprint, run: rr.RecordingStream) -> None:
        files.append(folder / f"{len(files)}.rrd")
        run.save(files[-1], default_blueprint=layout)

    viewer: ViewerService | None = None
    for sample in _frames(recording.samples()):
        if viewer is None:
            if sample.stamp is None:
                continue  # before the first run
            scenario = recording.scenario(sample.stamp.run, *SECTIONS)
            bus.renamed = scenario.renamed
            viewer = ViewerService("viewer", bus, scenario)
            viewer.send = partial(save, blueprint(scenario.names))
        try:
            bus.put_bytes(sample.key, *sample.as_published())
        except RefusedError:
            continue
    if viewer is None:
        raise ConfigError(f"{file}: holds no run")
    viewer.end()
    return files


def _frames(samples: Iterable[Any]) -> Iterator[Any]:
    """Return the samples at the rate at which the viewer draws them in a live run."""
    shown: dict[str, tuple[int, int]] = {}  # run and time [ns] of the last sample of each key
    for sample in samples:
        run = -1 if sample.stamp is None else sample.stamp.run
        last_run, last_ns = shown.get(sample.key, (None, 0))
        if last_run != run or sample.time_ns - last_ns >= FRAME_NS:
            shown[sample.key] = run, sample.time_ns
            yield sample
