"""A follower that knows the true person: its errors are those of control and robot."""

import pytest
from harness import SCENARIOS
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.simulate import simulate

ORACLE = 'programs.follower="mecazen_experiments.oracle:OracleFollower"'


def run(*settings, scenario="back"):
    settings = ("sim.duration_s=4", *settings)
    return simulate(
        load_scenario(SCENARIOS / f"{scenario}.toml", parse_settings(settings)), scenario
    )[0]


@pytest.mark.parametrize("scenario", ["back", "side"])
def test_the_error_of_an_oracle_is_that_of_the_robot(scenario):
    oracle = run(ORACLE, scenario=scenario)
    seen = run(scenario=scenario)
    # 0.2 m/s take 0.08 s at 2.5 m/s²: 8 mm at the start, and no more later
    assert oracle.d_err_m < 2e-3
    assert oracle.theta_err_deg < 0.1
    assert seen.theta_err_deg > 5 * oracle.theta_err_deg


def test_an_oracle_needs_no_sensor():
    blinded = run(ORACLE, "sensor.occlusions_s=[[0, 100]]")
    assert blinded.trajectory_sha256 == run(ORACLE).trajectory_sha256
