"""Does the runs of a study on this machine or a Dask cluster, and keeps each in SQLite."""

from __future__ import annotations

import gc
import importlib
import logging
import re
import sqlite3
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
from mecazen.errors import ConfigError, MecazenError
from mecazen_tools.pool import CORES, processes

from mecazen_experiments.expansion import Job
from mecazen_experiments.study import PROGRAMS, Value
from mecazen_experiments.versions import version

T = TypeVar("T")
Columns = Mapping[str, Value]
"""The columns of a run, from its program."""
Progress = Callable[[int, int], None]
"""Function that is called with the number of finished runs, and of all runs."""

MAX_TRIES = 3
"""Maximum number of starts of a job whose worker dies."""
CONNECT_S = 2.0
BUSY_S = 60.0
"""Time to wait for the write of another command, which takes milliseconds."""
_TABLE = "create table if not exists runs (key text primary key, columns text) without rowid"


class RunsFailedError(MecazenError):
    """Failed runs, one line each; the others are finished and kept."""

    def __init__(self, failures: Iterable[tuple[Job, MecazenError]]) -> None:
        lines = sorted(f"{job}: {error}" for job, error in failures)
        super().__init__("\nerror: ".join(lines))


class Workers(NamedTuple):
    """Processes that do jobs."""

    number: int
    start: Callable[[int], AbstractContextManager[Executor]] | None
    """Returns an executor for a number of jobs; None for this process."""
    death: type[Exception] = BrokenProcessPool
    """The error of a job whose worker died."""


class Store:
    """The columns of finished runs by key, in a file that may be shared with other commands.

    Each run is a transaction: it is stored completely or not at all. The first result of a key is
    kept; a second one would be equal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._one_line():
            # autocommit: each statement is a separate transaction
            self._database = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
            self._database.execute(_TABLE)

    def find(self, keys: Iterable[str]) -> dict[str, Columns]:
        """Return the columns of the keys that are stored."""
        stored: dict[str, Columns] = {}
        query = "select columns from runs where key = ?"
        with self._one_line():
            for key in keys:
                row = self._database.execute(query, (key,)).fetchone()
                if row is not None:
                    stored[key] = msgspec.json.decode(row[0], type=dict[str, Any])
        return stored

    def add(self, key: str, columns: Columns) -> Columns:
        """Store the columns of a run; return them as `find` does: NaN and infinity are None."""
        text = msgspec.json.encode(columns).decode()
        with self._one_line():
            self._database.execute("insert or ignore into runs values (?, ?)", (key, text))
        return self.find([key])[key]

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    @contextmanager
    def _one_line(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, msgspec.ValidationError, msgspec.DecodeError) as error:
            raise MecazenError(f"{self.path}: can't be used as a store: {error}") from None


def run_all(
    jobs: Sequence[Job],
    store: Store,
    workers: Workers,
    progress: Progress = lambda *_: None,
    check: Callable[[Job, Columns], object] = lambda *_: None,
) -> dict[str, Columns]:
    """Return the columns of every job by key; each is stored as soon as it exists.

    A stored run is never repeated. `check` sees the first result, and may raise an error, which
    ends the other runs.

    Raises:
        RunsFailedError: Some runs failed; the others are stored.
    """
    by_key = {job.key: job for job in jobs}
    results = store.find(by_key)
    for key in list(results)[:1]:
        check(by_key[key], results[key])
    progress(len(results), len(by_key))
    todo = [job for key, job in by_key.items() if key not in results]
    with closing(do_all(run, todo, workers)) as outcomes:
        for job, columns in outcomes:
            first = not results
            results[job.key] = store.add(job.key, columns)
            if first:
                check(job, results[job.key])
            progress(len(results), len(by_key))
    return results


def run(job: Job) -> Columns:
    """Simulate and measure a job."""
    # reference cycles hold the last run's DART world, of many megabytes
    gc.collect()
    module = PROGRAMS[job.program]
    if job.version != version(module):
        raise MecazenError("this worker has other versions of mecazen or of its libraries")
    columns: Columns = getattr(importlib.import_module(module), job.program)(job)
    return columns


def do_all(
    work: Callable[[Job], T], jobs: Sequence[Job], workers: Workers
) -> Generator[tuple[Job, T], None, None]:
    """Yield each job with its result as it finishes; retry the job of a worker that dies.

    When a worker dies, other workers may end with it. Jobs that may have been running are retried
    after all others, one at a time, so that the failing job can be identified.
    """
    failures: list[tuple[Job, MecazenError]] = []
    batches = deque([list(jobs)] if jobs else [])
    tries: Counter[str] = Counter()
    while batches:
        waiting = {job.key: job for job in batches.popleft()}
        with closing(_outcomes(work, [*waiting.values()], workers)) as outcomes:
            for job, outcome in outcomes:
                del waiting[job.key]
                if isinstance(outcome, MecazenError):
                    failures.append((job, outcome))
                else:
                    yield job, outcome
        left = [*waiting.values()]
        begun, idle = left[: workers.number], left[workers.number :]
        tries.update(job.key for job in begun)
        if idle:
            batches.appendleft(idle)
        batches += ([job] for job in begun if tries[job.key] < MAX_TRIES)
        dead = MecazenError("its worker died, each time it was tried")
        failures += [(job, dead) for job in begun if tries[job.key] >= MAX_TRIES]
    if failures:
        raise RunsFailedError(failures)


def _outcomes(
    work: Callable[[Job], T], jobs: Sequence[Job], workers: Workers
) -> Generator[tuple[Job, T | MecazenError], None, None]:
    """Yield jobs with results or errors, but for jobs that were unfinished when a worker died."""
    if workers.start is None:
        yield from ((job, _attempt(work, job)) for job in jobs)
        return
    with workers.start(len(jobs)) as pool:
        futures = {}
        with suppress(workers.death):
            for job in jobs:
                futures[pool.submit(_attempt, work, job)] = job
        for future in as_completed(futures):
            with suppress(workers.death):
                yield futures[future], future.result()


def _attempt(work: Callable[[Job], T], job: Job) -> T | MecazenError:
    """Return the result of a job, or its error without its class, which may not be picklable."""
    try:
        return work(job)
    except MecazenError as error:
        return MecazenError(str(error))


def local_workers(count: int | None = None) -> Workers:
    """Return processes of this machine, by default one for each core; of one, this process."""
    count = count or CORES
    return Workers(count, None if count == 1 else lambda jobs: processes(min(count, jobs)))


@contextmanager
def cluster_workers(address: str) -> Iterator[Workers]:
    """Yield the workers of a Dask scheduler; they need the same code and the same files.

    If a worker dies, the scheduler passes its job to another worker, and gives the job up after
    `allowed-failures`.
    """
    try:
        from distributed import Client, KilledWorker  # noqa: PLC0415  # an extra
    except ModuleNotFoundError:
        raise ConfigError("--cluster needs Dask: pip install 'mecazen[cluster]'") from None
    # checked here: with a wrong address Dask's client hangs at the end of the process
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", address):
        raise ConfigError(f"--cluster {address}: must be tcp://HOST:PORT or tls://HOST:PORT")
    # errors of the scheduler are reported in one line instead of the client's
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        connect: Any = Client  # which is not typed
        client = connect(address, timeout=CONNECT_S, set_as_default=False)
    except OSError:
        raise MecazenError(f"--cluster {address}: no Dask scheduler answers there") from None

    @contextmanager
    def start(_: int) -> Iterator[Executor]:
        pool = client.get_executor(pure=False)
        try:
            yield pool
        except CancelledError:
            raise MecazenError(f"{address}: the Dask scheduler has gone") from None
        finally:
            pool.shutdown(wait=False)

    with closing(client):
        if not (count := len(client.ncores())):
            raise MecazenError(
                f"--cluster {address}: it has no workers; start some: dask worker {address}"
            )
        yield Workers(count, start, KilledWorker)
