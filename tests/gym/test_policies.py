"""The policies that others are compared with."""

import math

import numpy as np
import pytest
from harness import SCENARIOS
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen_gym.follow import FollowEnv, Observation
from mecazen_gym.policies import POLICIES
from mecazen_gym.score import episode


@pytest.fixture(scope="module")
def env():
    env = FollowEnv("back")
    yield env
    env.close()


def seen(person, age_s=0.0, twist=(0.0, 0.0, 0.0)):
    x, y, yaw = person
    values = x, y, math.cos(yaw), math.sin(yaw), age_s, *twist, 0.0, 0.0, 0.0
    return np.array(Observation(*values), np.float32)


def test_random_actions_are_those_of_their_seed(env):
    actions = [POLICIES["random"](env, seed)(seen(Pose2D())) for seed in (1, 1, 2)]
    assert np.array_equal(actions[0], actions[1])
    assert not np.array_equal(actions[0], actions[2])
    assert all(action in env.action_space for action in actions)


def test_the_pid_drives_by_its_gains_to_the_place(env):
    # 1 m behind the person is 0.2 m ahead and 0.1 m to the right; they look where the robot does
    action = POLICIES["pid"](env, 0)(seen(Pose2D(1.2, -0.1, 0.0)))
    gain = 1.5 + 0.1 * 0.1  # kp, and ki over a period of 0.1 s
    assert action * env.scale == pytest.approx([gain * 0.2, -gain * 0.1, 0.0], abs=1e-6)  # float32


@pytest.mark.parametrize("policy", ["pid", "follower"])
def test_who_is_out_of_sight_for_too_long_is_not_driven_to(env, policy):
    act = POLICIES[policy](env, 0)
    assert np.any(act(seen(Pose2D(1.5, 0.0, 0.0))))
    for age_s in np.arange(0.1, 2.5, 0.1):
        action = act(seen(Pose2D(1.5, 0.0, 0.0), age_s))
    assert not np.any(action)


def test_the_follower_knows_where_it_went_while_it_saw_nobody(env):
    act = POLICIES["follower"](env, 0)
    for _ in range(20):
        act(seen(Pose2D(2.0, 0.0, 0.0)))
    # it goes 1 m ahead in 1 s and stops: then it is in its place, and the person stands
    for n in range(15):
        action = act(seen(Pose2D(2.0, 0.0, 0.0), 0.1 * (n + 1), (1.0 if n < 10 else 0.0, 0.0, 0.0)))
    assert action == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)  # it has braked by then


def test_the_follower_is_better_than_a_pid_and_that_than_chance():
    scenario = load_scenario(SCENARIOS / "back.toml", {"sim.duration_s": 4})
    by_chance, pid, follower = (episode(scenario, name, 1) for name in POLICIES)
    assert by_chance.reward < pid.reward < follower.reward
    assert by_chance.d_err_m > pid.d_err_m > follower.d_err_m
