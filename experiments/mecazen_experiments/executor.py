"""Executes runs on this machine or a Dask cluster; finished runs are kept in a store."""

from __future__ import annotations

import logging
import os
import re
import signal
import warnings
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from typing import Any, NamedTuple, TypeVar

from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from mecazen.errors import ConfigError, MecazenError

from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.report import Kind, Record
from mecazen_experiments.run import record
from mecazen_experiments.store import Store

T = TypeVar("T")

MAX_TRIES = 3
"""Maximum number of starts of a job whose worker dies."""
CONNECT_S = 2.0


Outcomes = Generator[tuple[Job, T | MecazenError], None, None]
"""Jobs with their results or errors, in the order of completion; closing it ends the work."""
Progress = Callable[[int, int], None]
"""Function that is called with the number of finished runs, and of all runs."""


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
    `allowed-failures`. joblib's backend for Dask would wait forever for such a job.
    """
    try:
        from distributed import Client, KilledWorker, as_completed  # noqa: PLC0415  # an extra
    except ModuleNotFoundError:
        raise ConfigError("--scheduler needs Dask: pip install 'mecazen[cluster]'") from None
    # checked here: with a wrong address Dask's client hangs at the end of the process
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", address):
        raise ConfigError(f"--scheduler {address}: must be tcp://HOST:PORT or tls://HOST:PORT")
    # errors of the scheduler are reported in one line instead of the client's
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        connect: Any = Client  # which is not typed
        client = connect(address, timeout=CONNECT_S, set_as_default=False)
    except OSError:
        raise MecazenError(f"--scheduler {address}: no Dask scheduler answers there") from None

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
                f"--scheduler {address}: it has no workers; start some: dask worker {address}"
            )
        yield Workers(count, do_once)


def do_all(
    work: Callable[[Job], T], jobs: Sequence[Job], workers: Workers
) -> Generator[tuple[Job, T], None, None]:
    """Yield each job with its result as it finishes; retry the job of a worker that dies.

    When a worker dies, other workers may end with it. Jobs that may have been running are retried
    after the rest, one at a time, so that the failing job can be identified.
    """
    failures: list[tuple[Job, MecazenError]] = []
    batches = deque([list(jobs)])
    tries: Counter[Job] = Counter()
    while batches:
        waiting = batches.popleft()
        with closing(workers.do_once(work, waiting)) as outcomes:
            for job, outcome in outcomes:
                waiting.remove(job)
                if isinstance(outcome, MecazenError):
                    failures.append((job, outcome))
                else:
                    yield job, outcome
        begun, rest = waiting[: workers.at_once], waiting[workers.at_once :]
        tries.update(begun)
        if rest:
            batches.appendleft(rest)
        batches += ([job] for job in begun if tries[job] < MAX_TRIES)
        dead = MecazenError("its worker died, each time it was tried")
        failures += [(job, dead) for job in begun if tries[job] >= MAX_TRIES]
    if failures:
        raise RunsFailedError(failures)


def run_all(
    kind: Kind[T],
    jobs: Iterable[Job],
    store: Store,
    workers: Workers,
    progress: Progress = lambda *_: None,
) -> dict[Key, Record[T]]:
    """Return the record of every job; each is stored as soon as it exists, and never repeated."""
    wanted = {job.key: job for job in jobs}
    records = store.find(kind, wanted)
    progress(len(records), len(wanted))
    todo = [job for key, job in wanted.items() if key not in records]
    with closing(do_all(partial(record, kind), todo, workers)) as results:
        for job, found in results:
            store.add(kind, found)
            records[job.key] = found
            progress(len(records), len(wanted))
    return records


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
