"""The error budget: the oracle, what the follower saw, and the command."""

import json
import math

import numpy as np
import pytest
from harness import SCENARIOS
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.budget import sights
from mecazen_tools.simulate import simulate
from mecazen_tools.table import Table

SHORT = ("sim.duration_s=4",)


def run(*settings, scenario="back"):
    loaded = load_scenario(SCENARIOS / f"{scenario}.toml", parse_settings((*SHORT, *settings)))
    return loaded, *simulate(loaded, scenario)


@pytest.mark.parametrize("frame", ["base_link", "world"])
@pytest.mark.parametrize("latency", [0.0, 0.08])
def test_sights_are_what_the_follower_saw(frame, latency):
    # the estimator none repeats each observation, placed in odom
    settings = "follower.estimator=none", f"sensor.frame={frame}", f"sensor.latency_s={latency}"
    scenario, _, trajectory = run(*settings, "sensor.dropout_probability=0.2")
    table = Table.of(trajectory)
    seen, truth = sights(scenario, table)
    ticks = [round((sight.time + latency) / table.tick_s) for sight in seen]
    estimates = table.poses("estimate")
    if latency:  # the first frames are from before anything was captured
        seen, ticks = seen[2:], ticks[2:]
    assert 50 < len(seen) < 100
    for sight, tick in zip(seen, ticks, strict=True):
        assert sight.pose == pytest.approx(estimates.at(tick), abs=1e-12)
    errors = (
        np.array([sight.pose[:2] for sight in seen]) - np.array([truth.x, truth.y]).T[-len(seen) :]
    )
    # 0.05 m on each axis; 80 frames estimate it to 10 %, of which three are allowed
    assert np.std(errors) == pytest.approx(0.05, rel=0.3)


def test_the_command_shows_the_parts_of_the_errors(folder):
    out, _ = folder.mecazen("budget", "short_experiment.toml", "--runs", 2, "--json", "out.json")
    assert "least by" in out
    (row,) = json.loads((folder.path / "out.json").read_text())["rows"]
    means = row["means"]
    assert means["control_theta_err_deg"]["mean"] < means["theta_err_deg"]["mean"]
    assert all(math.isfinite(mean["mean"]) for mean in means.values())
    assert means["d_err_m"]["n"] == means["smoother_yaw_deg"]["n"] == 2
