"""A run: a job simulated, observed and scored by a kind of experiment."""

from __future__ import annotations

import gc
import re
import time
from pathlib import Path
from typing import TypeVar

import msgspec
from mecazen.errors import MecazenError
from mecazen.files import to_value
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.observe import observe
from mecazen_tools.table import Table

from mecazen_experiments.jobs import Job, check_version
from mecazen_experiments.report import Kind, Record

T = TypeVar("T")


def record(kind: Kind[T], job: Job) -> Record[T]:
    """Simulate a job and score it."""
    check_version(job)
    # reference cycles hold the last run's DART world, of many megabytes
    gc.collect()
    begin = time.perf_counter()
    scores, sha256 = kind.measure(job)
    wall_s = time.perf_counter() - begin
    # not getrusage: its maximum includes the memory of the parent process
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    result = kind.record(job.key, sha256, scores, wall_s, int(found[1]) * 1024 / 1e6)
    try:
        # as a later command reads it: NaN and infinity are null in JSON, which is None
        return msgspec.json.decode(msgspec.json.encode(result), type=kind.record)
    except msgspec.ValidationError as error:
        raise MecazenError(f"a score that can't be missing is not finite: {error}") from None


def tabulate(job: Job) -> Table:
    """Simulate a job and return every tick of it; raises as `observe`."""
    check_version(job)
    return observe(job.load()).table


def file_name(job: Job) -> str:
    """Return the name of a job's row as a file name."""
    return re.sub(r"[^\w.=+-]+", "_", job.row.replace(", ", "-"))


def film(job: Job, folder: Path) -> Path:
    """Simulate a job, and record the whole run; return the file. Raises as `observe`."""
    check_version(job)
    file = folder / f"{file_name(job)}.mcap"
    recorded = (
        f"services={to_value([*job.load().services, 'recorder'])}",
        f"recorder.file={to_value(str(file))}",
    )
    observe(load_scenario(job.scenario, parse_settings((*job.settings, *recorded))))
    return file
