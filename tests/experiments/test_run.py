"""One run, simulated, observed and scored."""

import math
from contextlib import closing

import pytest
from harness import SCENARIOS
from mecazen.errors import MecazenError
from mecazen_experiments.budget import BOUND
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import jobs_of
from mecazen_experiments.run import record
from mecazen_experiments.scores import Score, Scores
from mecazen_experiments.store import Store

BACK = SCENARIOS / "back.toml"
SHORT = ("sim.duration_s=1.5",)


def test_a_record_has_the_scores_of_the_run_and_its_cost():
    (job,) = jobs_of("short", BACK, SHORT, (3,))
    found = record(FOLLOWING, job)
    assert found.key == job.key
    assert 0.0 < found.scores.whole.d_err_m < 0.2
    assert found.wall_s > 0.0
    assert 20.0 < found.peak_rss_mb < 1000.0
    assert FOLLOWING.numbers(found.scores)["settled_d_err_m"] is None


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_score_that_is_no_number_is_missing_now_and_in_the_store(value, tmp_path):
    (job,) = jobs_of("short", BACK, SHORT, (3,))
    kind = FOLLOWING._replace(measure=lambda _: (Scores(Score(d_err_m=value), Score()), "sha"))
    found = record(kind, job)
    assert found.scores.whole.d_err_m is None
    with closing(Store(tmp_path / "store.sqlite")) as store:
        store.add(kind, found)
        assert store.find(kind, [job.key]) == {job.key: found}
    bound = BOUND._replace(measure=lambda _: ({"position_m": value}, "sha"))
    with pytest.raises(MecazenError, match=r"not finite: .* at `\$\.scores\[\.\.\.\]`"):
        record(bound, job)
