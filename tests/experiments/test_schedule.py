"""All runs of a command, over made-up workers."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.schedule import Done, Failure, Outcomes, RunsFailedError, run_all
from mecazen_experiments.store import Store

from experiments import made_up


class Obedient:
    """Does what it is asked, but for a seed that it can't."""

    def __init__(self, fails: int | None = None) -> None:
        self.done: list[int] = []
        self._fails = fails

    def do(self, work: Callable[[Job], Any], jobs: Sequence[Job]) -> Outcomes[Any]:
        for job in reversed(jobs):
            if job.key.seed == self._fails:
                yield Failure(job, "out of the world")
                continue
            self.done.append(job.key.seed)
            yield Done(job, made_up.record(job.key, 0.1 * job.key.seed))


@pytest.fixture
def store(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")) as store:
        yield store


def jobs(*seeds: int) -> list[Job]:
    return [Job("row", None, Path("none.toml"), (), Key("sha", seed, "0")) for seed in seeds]


def test_what_is_stored_is_not_done_again(store):
    first, second = Obedient(), Obedient()
    run_all(jobs(1, 2), store, first)
    reported = []
    records = run_all(jobs(1, 2, 3), store, second, lambda *done: reported.append(done))
    assert second.done == [3]
    assert {key.seed for key in records} == {1, 2, 3}
    assert reported == [(2, 3), (3, 3)]


def test_what_two_rows_have_in_common_is_done_once(store):
    workers = Obedient()
    run_all([*jobs(1), *jobs(1)], store, workers)
    assert workers.done == [1]


def test_a_run_that_fails_is_named_and_the_rest_is_kept(store):
    with pytest.raises(RunsFailedError, match=r"^row, seed 2: out of the world$"):
        run_all(jobs(1, 2, 3), store, Obedient(fails=2))
    assert {key.seed for key in store.find([job.key for job in jobs(1, 2, 3)])} == {1, 3}
