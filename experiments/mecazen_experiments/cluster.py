"""Workers of a Dask cluster; needs the extra `cluster`."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from contextlib import closing
from typing import Any

from distributed import Client, KilledWorker, as_completed
from mecazen.errors import ConfigError, MecazenError

from mecazen_experiments.jobs import Job
from mecazen_experiments.schedule import Done, Failure, Outcomes, T, attempt, died

CONNECT_S = 10.0


class ClusterWorkers:
    """The workers at a Dask scheduler; they need the same code and see the same files.

    The scheduler itself gives the job of a worker that dies to another, and gives it up after
    its `allowed-failures`. joblib's backend for Dask would wait forever for such a job.

    Raises:
        ConfigError: The address is not as `tcp://192.0.2.1:8786`.
        MecazenError: Nothing answers there, or there are no workers.
    """

    def __init__(self, address: str) -> None:
        # checked here: with a wrong one Dask's client hangs at the end of the process
        if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", address):
            raise ConfigError(f"--scheduler {address}: must be tcp://HOST:PORT or tls://HOST:PORT")
        # errors of the scheduler are reported in one line instead of the client's
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._address = address
        try:
            connect: Any = Client  # which is not typed
            self._client = connect(address, timeout=CONNECT_S, set_as_default=False)
        except OSError:
            raise MecazenError(f"--scheduler {address}: no Dask scheduler answers there") from None
        if not self._client.ncores():
            self.close()
            raise MecazenError(
                f"--scheduler {address}: it has no workers; start some: dask worker {address}"
            )

    def do(self, work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        """See `Workers`.

        A job that the scheduler has given up is tried again after the rest, alone: another job
        may have killed its worker.
        """
        doubtful = []
        with closing(self._do_once(work, jobs)) as outcomes:
            for job, outcome in outcomes:
                if outcome is None:
                    doubtful.append(job)
                else:
                    yield outcome
        for job in doubtful:
            with closing(self._do_once(work, [job])) as outcomes:
                yield from (outcome or died(job) for _, outcome in outcomes)

    def _do_once(
        self, work: Callable[[Job], T], jobs: Sequence[Job]
    ) -> Generator[tuple[Job, Done[T] | Failure | None], None, None]:
        """Yield each job with its outcome, None if the scheduler has given it up."""
        futures = {self._client.submit(attempt, work, job, pure=False): job for job in jobs}
        try:
            for future in as_completed(  # type: ignore[no-untyped-call]
                futures, loop=self._client.loop
            ):
                try:
                    outcome = future.result()
                except KilledWorker:
                    outcome = None
                except CancelledError:
                    raise MecazenError(f"{self._address}: the Dask scheduler has gone") from None
                yield futures[future], outcome
        finally:
            self._client.cancel(list(futures))

    def close(self) -> None:
        """Leave the cluster."""
        self._client.close()
