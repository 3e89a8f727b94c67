"""All runs of a command: what is already in the store is not run again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing

from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.run import Record, run
from mecazen_experiments.store import Store
from mecazen_experiments.workers import Done, Failure, T, Workers

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
            match outcome:
                case Done(job, value):
                    keep(job, value)
                case Failure():
                    failures.append(outcome)
    if failures:
        raise RunsFailedError(failures)


def run_all(
    jobs: Iterable[Job], store: Store, workers: Workers, progress: Progress = lambda *_: None
) -> dict[Key, Record]:
    """Return the record of every job; each is stored as soon as it exists.

    Raises:
        MecazenError: As of `do_all`, or the store can't be used.
    """
    wanted = {job.key: job for job in jobs}
    records = store.find(wanted)
    progress(len(records), len(wanted))

    def keep(_: Job, record: Record) -> None:
        store.add(record)
        records[record.key] = record
        progress(len(records), len(wanted))

    do_all(run, [job for key, job in wanted.items() if key not in records], workers, keep)
    return records
