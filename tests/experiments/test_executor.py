"""All runs of a command, over made-up workers."""

from contextlib import closing, suppress
from pathlib import Path

import pytest
from mecazen.errors import MecazenError
from mecazen_experiments.executor import RunsFailedError, Workers, do_all, run_all
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import Job, Key
from mecazen_experiments.store import Store

from experiments import made_up


def obedient(done, fails=None):
    """Do what is asked, but for a seed that can't be done; note the seeds."""

    def do_once(_, jobs):
        for job in reversed(jobs):
            if job.key.seed == fails:
                yield job, MecazenError("out of the world")
                continue
            done.append(job.key.seed)
            yield job, made_up.record(job.key, 0.1 * job.key.seed)

    return Workers(1, do_once)


def mortal(batches, lethal, lives):
    """Two workers that both end where they meet a lethal seed, `lives` times; note the batches."""

    def do_once(work, jobs):
        nonlocal lives
        batches.append([job.key.seed for job in jobs])
        for number, job in enumerate(tuple(jobs)):
            if lethal in [one.key.seed for one in jobs[number : number + 2]] and lives:
                lives -= 1
                return
            yield job, work(job)

    return Workers(2, do_once)


@pytest.fixture
def store(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")) as store:
        yield store


def jobs(*seeds: int) -> list[Job]:
    return [Job("row", None, Path("none.toml"), (), Key("sha", seed, "0")) for seed in seeds]


def test_what_is_stored_or_shared_by_two_rows_is_done_once(store):
    done, reported = [], []
    run_all(FOLLOWING, [*jobs(1), *jobs(1, 2)], store, obedient(done))
    report = lambda *counts: reported.append(counts)  # noqa: E731
    records = run_all(FOLLOWING, jobs(1, 2, 3), store, obedient(done), report)
    assert done == [2, 1, 3]
    assert {key.seed for key in records} == {1, 2, 3}
    assert reported == [(2, 3), (3, 3)]


def test_a_run_that_fails_is_named_and_the_rest_is_kept(store):
    with pytest.raises(RunsFailedError, match=r"^row, seed 2: out of the world$"):
        run_all(FOLLOWING, jobs(1, 2, 3), store, obedient([], fails=2))
    assert {key.seed for key in store.find(FOLLOWING, [job.key for job in jobs(1, 2, 3)])} == {1, 3}


@pytest.mark.parametrize(
    ("lives", "batches"),
    [
        (1, [[1, 2, 3, 4], [3, 4], [1], [2]]),
        (9, [[1, 2, 3, 4], [3, 4], [1], [2], [2]]),
    ],
    ids=["once", "always"],
)
def test_jobs_that_may_have_killed_a_worker_are_tried_again_alone_after_the_rest(lives, batches):
    tried, found = [], []
    workers = mortal(tried, lethal=2, lives=lives)
    with (
        suppress(RunsFailedError)
        if lives == 1
        else pytest.raises(
            RunsFailedError, match=r"^row, seed 2: its worker died, each time it was tried$"
        )
    ):
        for job, seed in do_all(lambda job: job.key.seed, jobs(1, 2, 3, 4), workers):
            assert job.key.seed == seed
            found.append(seed)
    assert tried == batches
    assert sorted(found) == ([1, 2, 3, 4] if lives == 1 else [1, 3, 4])
