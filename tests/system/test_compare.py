"""Followers compared in one scenario, from the command line."""

import msgspec
import pytest
from mecazen_tools.comparison import FollowerRun, compare
from mecazen_tools.simulation import Simulation

DURATION_S = 1.5
"""The person begins to walk after 1 s."""
NEARER = "follower.standoff_m=0.9"


def test_each_follower_gets_the_scores_of_simulate_and_is_compared_seed_by_seed(here, tmp_path):
    picture = tmp_path / "comparison.pdf"
    options = ("--seeds", 2, "--duration", DURATION_S, "--json", "-o", picture)
    done = here("compare", "back", NEARER, "default", *options)
    assert (done.returncode, done.stderr) == (0, "")
    assert picture.read_bytes().startswith(b"%PDF")
    result = msgspec.json.decode(done.stdout)
    assert (result["scenario"], result["seeds"], result["reference"]) == ("back", [1, 2], "default")
    scores = {}
    for name, settings in ((NEARER, {"follower.standoff_m": 0.9}), ("default", {})):
        scores[name] = []
        for seed in (1, 2):
            with Simulation("back", settings, seed=seed, duration_s=DURATION_S) as sim:
                sim.run()
                scores[name].append(sim.scores().d_err_m)
        assert result["means"][name]["D_err [m]"]["mean"] == pytest.approx(sum(scores[name]) / 2)
    difference = result["differences"][NEARER]["D_err [m]"]
    expected = [mine - default for mine, default in zip(*scores.values(), strict=True)]
    assert (difference["n"], difference["mean"]) == (2, pytest.approx(sum(expected) / 2))


def test_a_measure_that_a_follower_lacks_is_not_compared():
    def run(**measures):
        return FollowerRun({f"{name} [%]": value for name, value in measures.items()}, [], None)

    runs = {"mine": {1: run(), 2: run()}, "default": {1: run(lost=0.5), 2: run(lost=0.0)}}
    result = compare("back", runs)
    assert result.means["default"].keys() == {"lost [%]"}
    assert (result.means["mine"], result.differences["mine"]) == ({}, {})
