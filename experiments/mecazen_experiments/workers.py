"""The interface of workers, and what they return."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Job

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
        """Say it in one line."""
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
