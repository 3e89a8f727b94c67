"""All runs of a command, over made-up workers."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from mecazen.errors import MecazenError
from mecazen_experiments.executor import Outcomes, RunsFailedError, do, run_all
from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.run import FOLLOWING
from mecazen_experiments.store import Store

from experiments import made_up


class Obedient:
    """Does what it is asked, but for a seed that it can't."""

    count = 1

    def __init__(self, fails: int | None = None) -> None:
        self.done: list[int] = []
        self._fails = fails

    def do_once(self, work: Callable[[Job], Any], jobs: Sequence[Job]) -> Outcomes[Any]:
        for job in reversed(jobs):
            if job.key.seed == self._fails:
                yield job, MecazenError("out of the world")
                continue
            self.done.append(job.key.seed)
            yield job, made_up.record(job.key, 0.1 * job.key.seed)


class Mortal:
    """Two workers that both end where they meet a lethal seed, which is done `lives` times."""

    count = 2

    def __init__(self, lethal: int, lives: int) -> None:
        self.batches: list[list[int]] = []
        self._lethal, self._lives = lethal, lives

    def do_once(self, work: Callable[[Job], Any], jobs: Sequence[Job]) -> Outcomes[Any]:
        self.batches.append([job.key.seed for job in jobs])
        for number, job in enumerate(tuple(jobs)):
            here = [one.key.seed for one in jobs[number : number + self.count]]
            if self._lethal in here and self._lives:
                self._lives -= 1
                return
            yield job, work(job)


@pytest.fixture
def store(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")) as store:
        yield store


def jobs(*seeds: int) -> list[Job]:
    return [Job("row", None, Path("none.toml"), (), Key("sha", seed, "0")) for seed in seeds]


def test_what_is_stored_is_not_done_again(store):
    first, second = Obedient(), Obedient()
    run_all(FOLLOWING, jobs(1, 2), store, first)
    reported = []
    records = run_all(FOLLOWING, jobs(1, 2, 3), store, second, lambda *done: reported.append(done))
    assert second.done == [3]
    assert {key.seed for key in records} == {1, 2, 3}
    assert reported == [(2, 3), (3, 3)]


def test_what_two_rows_have_in_common_is_done_once(store):
    workers = Obedient()
    run_all(FOLLOWING, [*jobs(1), *jobs(1)], store, workers)
    assert workers.done == [1]


def test_a_run_that_fails_is_named_and_the_rest_is_kept(store):
    with pytest.raises(RunsFailedError, match=r"^row, seed 2: out of the world$"):
        run_all(FOLLOWING, jobs(1, 2, 3), store, Obedient(fails=2))
    assert {key.seed for key in store.find(FOLLOWING, [job.key for job in jobs(1, 2, 3)])} == {1, 3}


def test_jobs_that_may_have_killed_a_worker_are_tried_again_alone_after_the_rest():
    workers = Mortal(lethal=2, lives=1)
    outcomes = dict(do(lambda job: job.key.seed, jobs(1, 2, 3, 4), workers))
    assert workers.batches == [[1, 2, 3, 4], [3, 4], [1], [2]]
    assert [outcomes[job] for job in jobs(1, 2, 3, 4)] == [1, 2, 3, 4]


def test_a_job_whose_worker_dies_each_time_is_given_up():
    workers = Mortal(lethal=2, lives=9)
    outcomes = dict(do(lambda job: job.key.seed, jobs(1, 2, 3), workers))
    assert outcomes[jobs(1)[0]] == 1
    assert str(outcomes[jobs(2)[0]]) == "its worker died, each time it was tried"
    assert workers.batches == [[1, 2, 3], [3], [1], [2], [2]]
