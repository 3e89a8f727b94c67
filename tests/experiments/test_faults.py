"""Following with one fault of the sensor at a time, beside the same run without it."""

from pathlib import Path

import pytest
from mecazen.loading import load_scenario, load_table, parse_settings
from mecazen_experiments.config import Experiment, experiment_path
from mecazen_experiments.scores import score
from mecazen_tools.simulate import simulate
from mecazen_tools.table import Table

SCENARIO = Path(__file__).parents[2] / "configs" / "scenarios" / "back.toml"
WALK = "target.path={ kind = 'circle', radius_m = 3.0, speed_m_s = 0.5, start_after_s = 0.5 }"
SHORT = ("sim.duration_s=12", WALK)
CLEAN = "clean"
FAULTS = {
    CLEAN: "{}",
    "outliers": "{ outlier_probability = 0.02 }",
    "flips": "{ flip_probability = 0.03 }",
    "reported noise halved": "{ reported_noise_ratio = 0.5 }",
    "reported noise doubled": "{ reported_noise_ratio = 2.0 }",
    "second person": "{ other_m = 1.0, ids = true }",
    "stand-in": "{ other_m = 1.0, other_seen = false, stand_ins_s = [[5.0, 7.0]] }",
    "unsaid latency": "{ unsaid_latency_s = 0.1 }",
}


@pytest.fixture(scope="module")
def found():
    """The scores with each fault."""

    def scored(faults):
        scenario = load_scenario(SCENARIO, parse_settings((*SHORT, f"sensor.faults={faults}")))
        standoff = scenario.follower.standoff
        return score(Table.of(simulate(scenario, "faults")[1]), standoff).whole

    return {name: scored(faults) for name, faults in FAULTS.items()}


@pytest.mark.parametrize("fault", FAULTS.keys() - {CLEAN})
def test_no_single_fault_costs_half_the_distance_error_more(found, fault):
    assert found[fault].d_err_m < 1.5 * found[CLEAN].d_err_m
    # nor is the robot drawn to where the person is not
    assert found[fault].d_max_m < found[CLEAN].d_max_m + 0.15


def test_the_experiment_says_what_each_fault_may_cost():
    cases = {case.name: case for case in load_table(experiment_path("faults"), Experiment).cases}
    assert {f"recorded, {fault}" for fault in FAULTS} <= cases.keys()
