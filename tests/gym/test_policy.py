"""A policy of trained constants: in its environments, and as a follower of a scenario."""

import math

import gymnasium
import mecazen_gym
import numpy as np
import pytest
from harness import SCENARIOS, error_of
from mecazen.errors import ConfigError
from mecazen.keys import CMD_VEL
from mecazen.loading import load_scenario
from mecazen_gym.policy import SIZE, Policy, PolicyFollower, read_weights
from mecazen_gym.vector import FollowVectorEnv
from mecazen_tools.simulation import Simulation

gymnasium.register_envs(mecazen_gym)

NOISELESS = {"sensor.position_std_m": 0.0, "sensor.yaw_std_deg": 0.0}
CIRCLE = {"target.path": {"kind": "circle", "radius_m": 2.0, "speed_m_s": 0.6}}
POLICY = {"programs.follower": "mecazen_gym.policy:PolicyFollower"}
SAMPLED = {"programs.follower": "mecazen_gym.policy:SampledFollower"}


def commands(settings, duration_s=3.0):
    """Return the commanded twist at each tick of a run, and the robot's last pose."""
    with Simulation("back", {**settings, "sim.duration_s": duration_s}) as sim:
        twists = []
        for _ in sim.ticks(duration_s):
            twists.append(sim.latest(CMD_VEL.key).to_planar())
        return np.array(twists), np.array(sim.state.robot)


def test_an_untrained_policy_keeps_its_place_behind_who_walks_straight_on_without_noise():
    path = {"target.path": {"kind": "waypoints", "points_m": [[0, 0], [30, 10]], "speed_m_s": 0.8}}
    envs = FollowVectorEnv(2, "back", {**NOISELESS, **path}, duration_s=20.0)
    policy = Policy(np.zeros((2, SIZE)), envs.task)
    observations, infos = envs.reset(seed=1)
    for _ in range(199):
        observations, *_, infos = envs.step(policy.act(observations))
    # the filters have no error at a constant velocity, and the factors of the law are 1
    np.testing.assert_allclose(infos["place_error_m"], 0.0, atol=2e-3)
    np.testing.assert_allclose(infos["heading_error_rad"], 0.0, atol=2e-3)


def test_nobody_seen_yet_or_any_more_stops_the_robot():
    envs = FollowVectorEnv(1, "back", {"sensor.occlusions_s": [[2.0, 20.0]]}, duration_s=10.0)
    policy = Policy(np.zeros(SIZE), envs.task)
    observations, _ = envs.reset(seed=1)
    unseen = observations.copy()
    unseen[0, 4] = 10.0
    assert not Policy(np.zeros(SIZE), envs.task).act(unseen).any()
    moves = []
    for _ in range(99):
        actions = policy.act(observations)
        moves.append(bool(actions.any()))
        observations, *_ = envs.step(actions)
    # follower.lost_after_s after the last frame
    assert moves[50]
    assert not any(moves[61:])


def test_the_follower_drives_as_the_policy_does_in_its_environment():
    twists, pose = commands({**NOISELESS, **CIRCLE, **POLICY}, 10.0)
    changes = np.flatnonzero(np.any(np.diff(twists, axis=0), axis=1)) + 1
    assert {*(changes % 10)} == {changes[0] % 10}  # every 0.1 s
    env = gymnasium.make(
        "mecazen/Follow-v0", settings={**NOISELESS, **CIRCLE}, duration_s=10.0
    ).unwrapped
    policy = Policy(np.zeros(SIZE), env.task)
    observation, info = env.reset(seed=1)
    truncated = False
    while not truncated:
        observation, _, _, truncated, info = env.step(policy.act(observation[None])[0])
    env.close()
    # the follower's command acts a tick earlier, in which the person walks 6 mm
    assert math.dist(info["robot"][:2], pose[:2]) < 0.01


def test_the_sampled_follower_commands_at_the_rate_of_a_policy():
    twists, _ = commands(SAMPLED)
    changes = np.flatnonzero(np.any(np.diff(twists, axis=0), axis=1)) + 1
    assert changes.size > 15
    assert {*(changes % 10)} == {changes[0] % 10}


def test_files_without_weights_are_refused_in_one_line(tmp_path):
    text, short = tmp_path / "text.npz", tmp_path / "short.npz"
    text.write_text("weights")
    np.savez(short, weights=np.zeros(3))
    for file, reason in ((text, "no weights of a policy"), (short, f"{SIZE} numbers are needed")):
        assert reason in error_of(ConfigError, lambda file=file: read_weights(file))
        settings = {**POLICY, "follower.policy": str(file)}
        scenario = load_scenario(SCENARIOS / "back.toml", settings)
        with pytest.raises(ConfigError, match=reason):
            PolicyFollower(scenario)
