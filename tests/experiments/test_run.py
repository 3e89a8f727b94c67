"""One run, simulated, observed and scored."""

import math
from contextlib import closing

import pytest
from harness import SCENARIOS, error_of
from mecazen.errors import ConfigError, MecazenError
from mecazen.keys import CLOCK, ODOM
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.budget import BOUND
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import jobs_of
from mecazen_experiments.run import observe, observe_bodies, record
from mecazen_experiments.scores import Score, Scores
from mecazen_experiments.store import Store
from mecazen_tools.simulate import simulate

BACK = SCENARIOS / "back.toml"
SHORT = ("sim.duration_s=1.5",)


def test_a_run_is_that_of_the_command_line_with_all_samples_of_some_topics():
    scenario = load_scenario(BACK, parse_settings(SHORT))
    seen = observe(scenario, CLOCK, ODOM)
    assert seen.trajectory_sha256 == simulate(scenario, "back")[0].trajectory_sha256
    assert len(seen.table) == 150
    assert [len(of) for of in seen.samples.values()] == [150, 150]


def test_a_run_is_driven_in_every_tick_but_the_last():
    ticks = []

    def drive(tick, samples):
        ticks.append((tick, len(samples[CLOCK.key])))
        return {}

    observe(load_scenario(BACK, {"sim.duration_s": 0.05}), CLOCK, drive=drive)
    assert ticks == [(tick, tick) for tick in range(1, 5)]


def test_bodies_are_observed_only_where_a_tracker_reports_them():
    text = error_of(ConfigError, lambda: observe_bodies(load_scenario(BACK, parse_settings(SHORT))))
    assert "sensor.kind" in text


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
