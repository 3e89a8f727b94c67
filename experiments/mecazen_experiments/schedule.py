"""All runs of a command: what is already in the store is not run again; the rest workers do."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from typing import Generic, NamedTuple, Protocol, TypeVar

from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.run import Record, run
from mecazen_experiments.store import R, Records

T = TypeVar("T")

MAX_TRIES = 3
"""How often a job is started whose worker dies."""


class Done(NamedTuple, Generic[T]):
    """A job that was done, and its result."""

    job: Job
    value: T


class Failure(NamedTuple):
    """A job that failed, and why, in one line."""

    job: Job
    reason: str

    def __str__(self) -> str:
        return f"{self.job}: {self.reason}"


Outcomes = Generator[Done[T] | Failure, None, None]
"""Of jobs, in the order of completion; closing it ends the work."""


class Workers(Protocol):
    """Processes that do jobs, as many at a time as there are."""

    def do(self, work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        """Yield the outcome of each job; the work of a worker that dies is done again.

        Raises:
            MecazenError: There are no workers any more.
        """


def attempt(work: Callable[[Job], T], job: Job) -> Done[T] | Failure:
    """Do a job; a `MecazenError` is an outcome too."""
    try:
        return Done(job, work(job))
    except MecazenError as error:
        return Failure(job, str(error))


def died(job: Job) -> Failure:
    """Return the outcome of a job that kills its workers."""
    return Failure(job, "its worker died, each time it was tried")


Progress = Callable[[int, int], None]
"""Is called with the number of runs that are done, and of all."""


class RunsFailedError(MecazenError):
    """Runs that failed, a line each; the others are done and kept."""

    def __init__(self, failures: Iterable[Failure]) -> None:
        super().__init__("\nerror: ".join(sorted(map(str, failures))))


def do_all(
    work: Callable[[Job], T], jobs: Sequence[Job], workers: Workers, keep: Callable[[Job, T], None]
) -> None:
    """Do some work on each job; `keep` is called with each result.

    Raises:
        RunsFailedError: Some could not be done; all others were.
        MecazenError: There are no workers any more.
    """
    failures = []
    with closing(workers.do(work, jobs)) as outcomes:
        for outcome in outcomes:
            if isinstance(outcome, Failure):
                failures.append(outcome)
            else:
                keep(*outcome)
    if failures:
        raise RunsFailedError(failures)


def run_all(
    jobs: Iterable[Job],
    store: Records[Record],
    workers: Workers,
    progress: Progress = lambda *_: None,
) -> dict[Key, Record]:
    """Return the record of every job; see `do_new`."""
    return do_new(run, jobs, store, workers, progress)


def do_new(
    work: Callable[[Job], R],
    jobs: Iterable[Job],
    store: Records[R],
    workers: Workers,
    progress: Progress = lambda *_: None,
) -> dict[Key, R]:
    """Return what `work` makes of every job; each is stored as soon as it exists.

    Raises:
        MecazenError: As of `do_all`, or the store can't be used.
    """
    wanted = {job.key: job for job in jobs}
    records = store.find(wanted)
    progress(len(records), len(wanted))

    def keep(_: Job, record: R) -> None:
        store.add(record)
        records[record.key] = record
        progress(len(records), len(wanted))

    do_all(work, [job for key, job in wanted.items() if key not in records], workers, keep)
    return records
