"""Every scenario's trajectory, pinned to the bit: 10 s in one process, against hashes.json.

`.venv/bin/python tests/system/test_hashes.py` writes hashes.json, for a change that moves
trajectories on purpose.
"""

import json
from pathlib import Path

import pytest
from mecazen.loading import load_scenario
from mecazen_tools.simulate import simulate

FILE = Path(__file__).with_name("hashes.json")
CONFIGS = Path(__file__).parents[2] / "configs"
SCENARIOS = {
    str(path.relative_to(CONFIGS).with_suffix("")): path
    for folder in ("paper", "scenarios")
    for path in sorted((CONFIGS / folder).glob("*.toml"))
}


def outcome(name):
    """Return hash and scores of 10 s of a scenario, with its own seed."""
    result, _ = simulate(load_scenario(SCENARIOS[name], {"sim.duration_s": 10.0}), name)
    return {key: getattr(result, key) for key in ("trajectory_sha256", "d_err_m", "theta_err_deg")}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_has_its_pinned_trajectory_and_scores(name):
    assert outcome(name) == json.loads(FILE.read_text())[name]


@pytest.mark.parametrize("view", ["back", "side"])
def test_each_estimator_improves_on_the_one_before(view):
    pinned = json.loads(FILE.read_text())
    raw, published, default = (
        pinned[scenario]
        for scenario in (f"paper/{view}_without", f"paper/{view}_with", f"scenarios/{view}")
    )
    for score in ("d_err_m", "theta_err_deg"):
        assert default[score] < published[score] < raw[score]


if __name__ == "__main__":
    FILE.write_text(json.dumps({name: outcome(name) for name in SCENARIOS}, indent=2) + "\n")
