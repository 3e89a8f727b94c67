"""A run in this process, and its result."""

import pytest
from harness import error_of, load_robot
from mecazen.config import Scenario, SimConfig
from mecazen.errors import ConfigError, MecazenError
from mecazen_tools.simulate import collect, result, simulate
from tools.runs import Run

CARTS = Scenario(
    load_robot(), ("physics",), {"physics": "carts:Carts"}, sim=SimConfig(duration_s=1.5)
)
"""A world that needs no physics."""
TWO_TICKS = Scenario(load_robot(), seed=7, sim=SimConfig(duration_s=0.02))


def test_a_run_has_every_tick_and_the_same_hash_again():
    done = []
    told, trajectory = simulate(CARTS, "carts", done.append)
    assert (told.scenario, told.ticks, told.duration_s) == ("carts", 150, 1.5)
    assert (len(trajectory.rows()), done) == (150, [100, 150])
    assert told.rtf == pytest.approx(1.5 / told.wall_s)
    assert told.trajectory_sha256 == simulate(CARTS, "again")[0].trajectory_sha256


def test_the_result_has_the_scores_of_the_run():
    run = Run(2)
    for tick in range(2):
        run.tick(tick, robot=(0.1 * tick, 0.0, 0.0), person=(1.3 + 0.2 * tick, 0.0, 0.0))
    told = result(TWO_TICKS, "by hand", run.trajectory, wall_s=0.01)
    assert (told.seed, told.ticks, told.rtf) == (7, 2, pytest.approx(2.0))
    scores = run.trajectory.scores(TWO_TICKS.follower.standoff)
    assert (told.d_err_m, told.theta_err_deg) == (scores.d_err_m, scores.theta_err_deg)
    assert told.d_err_m == pytest.approx(0.4)  # beyond 1 m, once the person has moved
    assert told.robots == {}


def test_a_run_that_is_not_whole_has_no_result():
    run = Run(2)
    run.tick(0)
    said = error_of(MecazenError, lambda: result(TWO_TICKS, "cut", run.trajectory, 0.01))
    assert said == "the run ended after 1 of 2 ticks"


def test_only_a_run_in_lockstep_with_a_collector_is_collected():
    said = error_of(ConfigError, lambda: collect(TWO_TICKS, "real time"))
    assert said.endswith("need sim.mode=lockstep, and 'collector' among `services`")
