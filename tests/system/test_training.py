"""The example that trains, and its policy as a follower in full physics."""

import subprocess
import sys

import msgspec
import numpy as np
from harness import COMMAND_GUARD_S, ROOT, SCENARIOS, mecazen
from mecazen.loading import load_scenario
from mecazen_gym.policy import SIZE
from mecazen_tools.simulate import simulate, simulate_distributed

WEIGHTS = ROOT / "examples" / "weights.npz"
POLICY = {
    "programs.follower": "mecazen_gym.policy:PolicyFollower",
    "follower.policy": str(WEIGHTS),
    "sim.duration_s": 3.0,
}


def test_two_generations_write_weights_that_compare_takes(tmp_path):
    arguments = ROOT / "examples" / "train.py", "mine.npz", "2"
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=COMMAND_GUARD_S,
        check=False,
    )
    assert done.stdout.startswith("generation 0: cost "), done.stderr
    weights = np.load(tmp_path / "mine.npz")["weights"]
    assert weights.shape == (SIZE,)
    assert weights.any()
    short = ("--seeds", "1", "--duration", "2", "--json")
    compared = mecazen("compare", "back", "policy:mine.npz", "default", *short, folder=tmp_path)
    means = msgspec.json.decode(compared.stdout)["means"]
    assert [*means] == ["mine.npz", "default"], compared.stderr


def test_a_policy_drives_over_zenoh_as_in_one_process():
    result, _ = simulate(load_scenario(SCENARIOS / "back.toml", POLICY), "back")
    settings = tuple(f"{key}={value}" for key, value in POLICY.items())
    distributed, _ = simulate_distributed(SCENARIOS / "back.toml", settings, "back")
    assert distributed.trajectory_sha256 == result.trajectory_sha256
