"""Does the runs of a study on this machine or a Dask cluster, and keeps each in SQLite."""

from __future__ import annotations

import gc
import logging
import os
import re
import signal
import sqlite3
import warnings
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from mecazen.errors import ConfigError, MecazenError

from mecazen_experiments.expansion import Job
from mecazen_experiments.programs import PROGRAMS, Value
from mecazen_experiments.versions import version

T = TypeVar("T")
Columns = Mapping[str, Value]
"""The columns of a run, from its program."""
Outcomes = Generator[tuple[Job, T | MecazenError], None, None]
"""Jobs with their results or errors, in the order of completion; closing it ends the work."""
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

    at_once: int
    """The number of jobs that may be running when a worker dies."""
    do_once: Callable[[Callable[[Job], Any], Sequence[Job]], Outcomes[Any]]
    """Yields outcomes; jobs that were unfinished when a worker died have no outcome."""


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
    program = PROGRAMS[job.program]
    if job.version != version(program.__module__):
        raise MecazenError("this worker has other versions of mecazen or of its libraries")
    return program(job)


def do_all(
    work: Callable[[Job], T], jobs: Sequence[Job], workers: Workers
) -> Generator[tuple[Job, T], None, None]:
    """Yield each job with its result as it finishes; retry the job of a worker that dies.

    When a worker dies, other workers may end with it. Jobs that may have been running are retried
    after all others, one at a time, so that the failing job can be identified.
    """
    failures: list[tuple[Job, MecazenError]] = []
    batches = deque([list(jobs)])
    tries: Counter[str] = Counter()
    while batches:
        waiting = {job.key: job for job in batches.popleft()}
        with closing(workers.do_once(work, [*waiting.values()])) as outcomes:
            for job, outcome in outcomes:
                del waiting[job.key]
                if isinstance(outcome, MecazenError):
                    failures.append((job, outcome))
                else:
                    yield job, outcome
        left = [*waiting.values()]
        begun, idle = left[: workers.at_once], left[workers.at_once :]
        tries.update(job.key for job in begun)
        if idle:
            batches.appendleft(idle)
        batches += ([job] for job in begun if tries[job.key] < MAX_TRIES)
        dead = MecazenError("its worker died, each time it was tried")
        failures += [(job, dead) for job in begun if tries[job.key] >= MAX_TRIES]
    if failures:
        raise RunsFailedError(failures)


def local_workers(count: int = -1) -> Workers:
    """Return processes of this machine with one BLAS thread each; with a count of 1, this process.

    A count of -1 means one for each core. joblib keeps the processes for the next jobs.
    """

    def do_once(work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        # a warning about jobs that Ctrl-C left unfinished; the caller reports them in one line
        warnings.filterwarnings(
            "ignore", r"\d+ tasks which were still being processed", UserWarning
        )
        outcomes: Outcomes[T] | None = None
        try:
            with parallel_config(backend="loky", inner_max_num_threads=1), _as_workers():
                # jobs beyond the workers' queue would make loky's thread fail after Ctrl-C
                parallel = Parallel(
                    count,
                    return_as="generator_unordered",
                    batch_size=1,
                    pre_dispatch="2 * n_jobs",
                )
                outcomes = parallel(delayed(_attempt)(work, job) for job in tuple(jobs))
            # joblib may also end without this error
            with suppress(BrokenProcessPool):
                yield from outcomes
        finally:
            if outcomes is not None:
                outcomes.close()

    return Workers(effective_n_jobs(count), do_once)


@contextmanager
def cluster_workers(address: str) -> Iterator[Workers]:
    """Yield the workers of a Dask scheduler; they need the same code and the same files.

    If a worker dies, the scheduler passes its job to another worker, and gives the job up after
    `allowed-failures`. joblib's backend for Dask waits forever for such a job: its collector never
    calls back for a failed one. So jobs go to Dask's client directly.
    """
    try:
        from distributed import Client, KilledWorker, as_completed  # noqa: PLC0415  # an extra
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

    def do_once(work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        futures = [client.submit(_attempt, work, job, pure=False) for job in jobs]
        try:
            for future in as_completed(futures, loop=client.loop):  # type: ignore[no-untyped-call]
                try:
                    yield future.result()
                except KilledWorker:
                    continue
                except CancelledError:
                    raise MecazenError(f"{address}: the Dask scheduler has gone") from None
        finally:
            client.cancel(futures)

    with closing(client):
        if not (count := len(client.ncores())):
            raise MecazenError(
                f"--cluster {address}: it has no workers; start some: dask worker {address}"
            )
        yield Workers(count, do_once)


def _attempt(work: Callable[[Job], T], job: Job) -> tuple[Job, T | MecazenError]:
    """Run a job; a `MecazenError` is an outcome too."""
    try:
        return job, work(job)
    except MecazenError as error:
        # not the error itself: its class may not be picklable
        return job, MecazenError(str(error))


@contextmanager
def _as_workers() -> Iterator[None]:
    """Start processes that this process ends, and whose end this process reports.

    The processes ignore Ctrl-C, which a terminal sends to all processes. joblib's cleanup process
    would print a warning.
    """
    warned = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker:UserWarning"
    # Python's own cleanup process starts with the first worker, and its start unblocks Ctrl-C
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        del os.environ["PYTHONWARNINGS"]
        if warned is not None:
            os.environ["PYTHONWARNINGS"] = warned
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
