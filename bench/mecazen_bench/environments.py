"""Steps of the Gymnasium environment in a second: many robots on a plane, one in full physics."""

from __future__ import annotations

import time

import gymnasium
import mecazen_gym  # noqa: F401  # registers the environment

from mecazen_bench.harness import Tables

ROBOTS, STEPS = 1024, 200


def run() -> Tables:
    """Step 1,024 robots on a plane, and one in full physics, with random actions."""
    many = gymnasium.make_vec("mecazen/Follow-v0", ROBOTS, "vector_entry_point")
    one = gymnasium.make("mecazen/Follow-v0")
    rates = {f"{ROBOTS} on a plane": ROBOTS * rate(many), "one in full physics": rate(one)}
    return {
        "Environments on one core": {
            name: {"steps of 0.1 s in a second": (value, "more")} for name, value in rates.items()
        }
    }


def rate(env: gymnasium.Env | gymnasium.vector.VectorEnv) -> float:
    """Return how often an environment steps in a second; a step after an episode's end counts."""
    env.reset(seed=1)
    env.action_space.seed(1)
    action = env.action_space.sample()
    begin = time.perf_counter()
    for _ in range(STEPS):
        _, _, terminated, _, _ = env.step(action)
        if terminated is True:
            env.reset()
    seconds = time.perf_counter() - begin
    env.close()
    return STEPS / seconds
