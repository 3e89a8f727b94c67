"""Workers on the cores of this machine, by joblib."""

from __future__ import annotations

import os
import signal
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress

from joblib import Parallel, delayed, effective_n_jobs, parallel_config

from mecazen_experiments.jobs import Job
from mecazen_experiments.schedule import MAX_TRIES, Outcomes, T, attempt, died


class LocalWorkers:
    """Processes of this machine, one BLAS thread each; a single one is this process itself.

    -1 is one for each core.
    """

    def __init__(self, count: int = -1) -> None:
        self._count: int = effective_n_jobs(count)

    def do(self, work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        """See `Workers`.

        When a worker dies, joblib ends the others with it. Jobs that may have been running are
        then tried again after the rest, one at a time, so that it is clear whose worker dies.
        """
        batches = deque([list(jobs)])
        tries: Counter[Job] = Counter()
        while batches:
            waiting = batches.popleft()
            # joblib may also just end, without the error
            with suppress(BrokenProcessPool), closing(self._do_once(work, waiting)) as outcomes:
                for outcome in outcomes:
                    waiting.remove(outcome.job)
                    yield outcome
            begun, rest = waiting[: self._count], waiting[self._count :]
            tries.update(begun)
            if rest:
                batches.appendleft(rest)
            batches += ([job] for job in begun if tries[job] < MAX_TRIES)
            yield from (died(job) for job in begun if tries[job] >= MAX_TRIES)

    def _do_once(self, work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        outcomes: Outcomes[T] | None = None
        try:
            with parallel_config(backend="loky", inner_max_num_threads=1), as_workers():
                # jobs beyond the workers' queue would make loky's thread fail after Ctrl-C
                parallel = Parallel(
                    self._count,
                    return_as="generator_unordered",
                    batch_size=1,
                    pre_dispatch="2 * n_jobs",
                )
                outcomes = parallel(delayed(attempt)(work, job) for job in tuple(jobs))
            yield from outcomes
        finally:
            if outcomes is not None:
                with warnings.catch_warnings(action="ignore"):  # of unfinished jobs
                    outcomes.close()


@contextmanager
def as_workers() -> Iterator[None]:
    """Start processes that leave it to this one to end them, and to say why.

    They ignore Ctrl-C, which a terminal sends to all. joblib's process that removes what others
    leave behind would warn of it.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    warned = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker:UserWarning"
    try:
        yield
    finally:
        del os.environ["PYTHONWARNINGS"]
        if warned is not None:
            os.environ["PYTHONWARNINGS"] = warned
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
