"""Who does the runs: what is asked of them, and what they answer."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Job

T = TypeVar("T")

MAX_TRIES = 3
"""How often a run is begun whose worker dies."""


class Done(NamedTuple, Generic[T]):
    """A job that was done, and what it gave."""

    job: Job
    value: T


class Failure(NamedTuple):
    """A job that can't be done, and why, in one line."""

    job: Job
    reason: str

    def __str__(self) -> str:
        """Say it in one line."""
        return f"{self.job}: {self.reason}"


Outcomes = Generator[Done[T] | Failure, None, None]
"""Of jobs, as they come and in no order; to close it ends the work."""


class Workers(Protocol):
    """Processes that do jobs, as many at a time as there are."""

    def do(self, work: Callable[[Job], T], jobs: Sequence[Job]) -> Outcomes[T]:
        """Yield the outcome of each job; the work of a worker that dies is done again.

        Raises:
            MecazenError: There are no workers any more.
        """


def attempt(work: Callable[[Job], T], job: Job) -> Done[T] | Failure:
    """Do a job; a failure that the user is to be told of is an outcome too."""
    try:
        return Done(job, work(job))
    except MecazenError as error:
        return Failure(job, str(error))


def died(job: Job) -> Failure:
    """Return the outcome of a job that takes its workers with it."""
    return Failure(job, "its worker died, each time it was tried")
