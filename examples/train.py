"""Trains a policy on the plane by CMA-ES: "Training in five minutes" in docs/gym.md.

It chooses the constants of `mecazen_gym.policy.Policy` for random walkers and circles, behind the
person of the scenario `back`. Run from anywhere: python train.py [FILE.npz [GENERATIONS]]
"""

import sys

import cma
import numpy as np
from mecazen_gym.policy import PERIOD_S, SIZE, Policy
from mecazen_gym.vector import FollowVectorEnv

CANDIDATES, PERSONS = 24, 24
"""Sets of weights in a generation, and the persons that each of them follows."""
WALKS = [{"target.path": {"kind": "wander", "number": number}} for number in range(48)]
WALKS += [
    {"target.path": {"kind": "circle", "radius_m": radius_m, "speed_m_s": speed_m_s}}
    for radius_m in (0.7, 1.5, 3.0, 6.0)
    for speed_m_s in (0.4, 0.7, 1.0, 1.3)
]


def costs(envs: FollowVectorEnv, candidates: np.ndarray, generation: int) -> np.ndarray:
    """Return the mean logarithm of each candidate's cost: all follow the same persons."""
    policy = Policy(np.repeat(candidates, PERSONS, axis=0), envs.task)
    seeds = np.tile(generation * PERSONS + np.arange(PERSONS), CANDIDATES)
    observations, _ = envs.reset(seed=seeds.tolist())
    total, goes_on = np.zeros(envs.num_envs), np.ones(envs.num_envs, bool)
    while goes_on.any():
        observations, rewards, terminated, truncated, _ = envs.step(policy.act(observations))
        total -= rewards * goes_on
        goes_on &= ~(terminated | truncated)
    return np.array(np.log(total).reshape(CANDIDATES, PERSONS).mean(axis=1))


def main(file: str = "weights.npz", generations: str = "300") -> None:
    """Train, and write the weights."""
    robots = CANDIDATES * PERSONS
    envs = FollowVectorEnv(robots, "back", walks=WALKS, duration_s=30.0, period_s=PERIOD_S)
    options = {"popsize": CANDIDATES, "seed": 1, "verbose": -9}
    search = cma.CMAEvolutionStrategy(np.zeros(SIZE), 0.3, options)
    for generation in range(int(generations)):
        candidates = search.ask()
        values = costs(envs, np.array(candidates), generation)
        search.tell(candidates, values.tolist())
        if generation % 20 == 0:
            print(f"generation {generation}: cost {np.exp(values.mean()):.2f}", flush=True)
    np.savez(file, weights=search.mean)


if __name__ == "__main__":
    main(*sys.argv[1:])
