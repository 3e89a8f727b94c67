"""All runs of a command: what is stored already is not done again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import closing

from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.run import Record, run
from mecazen_experiments.store import Store
from mecazen_experiments.workers import Done, Failure, Workers

Progress = Callable[[int, int], None]
"""Is told how many runs are done, of how many."""


class RunsFailedError(MecazenError):
    """Runs that failed, a line each; the others are done and kept."""

    def __init__(self, failures: Iterable[Failure]) -> None:
        super().__init__("\nerror: ".join(sorted(map(str, failures))))


def run_all(
    jobs: Iterable[Job], store: Store, workers: Workers, progress: Progress = lambda *_: None
) -> dict[Key, Record]:
    """Return the record of every job, each kept in the store as soon as it is there.

    Raises:
        RunsFailedError: Some could not be done; all others were.
        MecazenError: The store can't be used, or there are no workers any more.
    """
    wanted = {job.key: job for job in jobs}
    records = store.find(wanted)
    progress(len(records), len(wanted))
    missing = [job for key, job in wanted.items() if key not in records]
    failures: list[Failure] = []
    with closing(workers.do(run, missing)) as outcomes:
        for outcome in outcomes:
            match outcome:
                case Done(_, record):
                    store.add(record)
                    records[record.key] = record
                case Failure():
                    failures.append(outcome)
            progress(len(records) + len(failures), len(wanted))
    if failures:
        raise RunsFailedError(failures)
    return records
