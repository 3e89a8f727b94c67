"""mecazen/Follow-v0 as Gymnasium wants it, and as its document says."""

import math

import gymnasium
import mecazen_gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from harness import ROOT
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import Odometry
from mecazen_gym.follow import CHANGE_M_S, HEADING_M_RAD, Observation

gymnasium.register_envs(mecazen_gym)

NAME = "mecazen/Follow-v0"
NOISELESS = {"sensor.position_std_m": 0.0, "sensor.yaw_std_deg": 0.0}
STILL = np.zeros(3, np.float32)


@pytest.fixture
def make():
    made = []

    def make(settings=(), **options):
        made.append(
            gymnasium.make(NAME, settings=dict(settings), **({"duration_s": 1.0} | options))
        )
        return made[-1]

    yield make
    for env in made:
        env.close()


def episode(env, seed, steps=3):
    """Return all observations and rewards of some actions."""
    observation, _ = env.reset(seed=seed)
    found = [observation]
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (steps, 3)).astype(np.float32):
        observation, reward, *_ = env.step(action)
        found += [observation, np.array([reward])]
    return np.concatenate(found)


def test_the_example_of_the_document_runs_until_chance_has_failed():
    names = {}
    example = (ROOT / "docs" / "gym.md").read_text().split("```python\n")[1].split("```")[0]
    exec(example, names)  # noqa: S102 - our own
    names["env"].close()
    assert (names["terminated"], names["truncated"]) == (True, False)


def test_gymnasiums_checker_finds_nothing(make):
    check_env(make(scenario="side").unwrapped)  # its warnings are errors here


def test_the_same_seed_and_actions_give_the_same_bits_also_in_other_processes(make):
    env = make()
    expected = episode(env, seed=8)
    assert not np.array_equal(episode(env, seed=7), expected)
    assert np.array_equal(episode(env, seed=8), expected)
    vector = gymnasium.make_vec(NAME, 2, vectorization_mode="async", duration_s=1.0)
    try:
        observations, _ = vector.reset(seed=7)  # 7 and 8
        found = [observations[1]]
        for action in np.random.default_rng(0).uniform(-1.0, 1.0, (3, 3)).astype(np.float32):
            observations, rewards, *_ = vector.step(np.stack((action, action)))
            found += [observations[1], rewards[1:]]
    finally:
        vector.close()
    assert np.array_equal(np.concatenate(found), expected)


def test_without_a_seed_each_episode_has_other_noise_and_all_follow_from_the_first_seed(make):
    env = make()

    def two_more():
        return [env.reset()[0] for _ in range(2)]

    env.reset(seed=3)
    first, second = two_more()
    assert not np.array_equal(first, second)
    env.reset(seed=3)
    assert np.array_equal(two_more(), [first, second])


def test_the_first_observation_is_the_person_seen_from_the_robot_at_rest(make):
    env = make(NOISELESS, scenario="side")
    observation, info = env.reset(seed=0)
    seen = Observation(*observation.tolist())
    # 1 m to the left of the person and facing them: the person is ahead, and looks to the left
    assert seen.person == pytest.approx(Pose2D(1.0, 0.0, math.pi / 2), abs=1e-6)  # float32
    assert seen[4:] == (0.0,) * 7
    assert info["place_error_m"] == pytest.approx(0.0, abs=1e-12)
    assert info["robot"] == pytest.approx([0.0, 1.0, -math.pi / 2])


def test_an_observation_is_what_was_seen_last_and_the_odometry_and_not_the_truth(make):
    env = make(NOISELESS)
    env.reset(seed=0)
    action = np.array([0.1, 0.0, 0.05], np.float32)
    observation, *_, info = env.step(action)
    sim, seen = env.unwrapped.sim, Observation(*observation.tolist())
    truth, odom = sim.state, sim.latest("odom")
    assert isinstance(odom, Odometry)
    assert seen[5:8] == pytest.approx(odom.twist.twist.to_planar(), abs=1e-6)
    assert seen[8:] == pytest.approx(action)
    assert seen.age_s == pytest.approx(0.02)  # frames at 25 Hz: the last one at 0.08 s
    robot = sim.trajectory.to_numpy()[8]
    at_capture = Pose2D(robot["robot_x_m"], robot["robot_y_m"], robot["robot_yaw_rad"])
    assert seen.person == pytest.approx(at_capture.between(truth.person), abs=1e-6)
    assert info["robot"] == pytest.approx(truth.robot)


def test_whom_the_sensor_does_not_see_grows_old(make):
    env = make({"sensor.occlusions_s": [[0.0, 0.01], [0.1, 9.0]]})
    observation, _ = env.reset(seed=0)
    seen = Observation(*observation.tolist())
    assert (seen.person, seen.age_s) == (pytest.approx(Pose2D(1.0, 0.0, 0.0)), 10.0)  # never yet
    observation, *_ = env.step(STILL)
    later, *_ = env.step(STILL)
    assert np.array_equal(later[:4], observation[:4])
    assert later[4] - observation[4] == pytest.approx(0.1)


def test_an_action_is_a_twist_within_the_robots_limits_for_a_period(make):
    env = make(period_s=0.05)
    env.reset()
    follow = env.unwrapped
    assert follow.scale == (2.0, 2.0, 3.0)  # 40 rad/s on wheels of 50 mm, and the controller's yaw
    assert follow.action(Twist2D(1.0, -9.0, 1.5)) == pytest.approx([0.5, -1.0, 0.5])
    *_, info = follow.step(np.array([0.5, -2.0, 0.0]))
    assert info["time_s"] == pytest.approx(0.05)
    assert follow.sim.latest("cmd_vel").to_planar() == (1.0, -2.0, 0.0)
    for wrong in (np.array([math.nan, 0.0, 0.0]), "left", [[0.0], 1.0, {}]):
        with pytest.raises(gymnasium.error.InvalidAction, match="three numbers"):
            follow.step(wrong)


def test_the_reward_is_minus_the_errors_over_time_and_the_change_of_the_action(make):
    env = make({"start.yaw_deg": 30.0, "start.x_m": -1.5})
    env.reset(seed=0)
    action = np.array([0.03, 0.0, 0.04], np.float32)
    _, reward, terminated, _, info = env.step(action)
    cost = info["place_error_m"] + HEADING_M_RAD * abs(info["heading_error_rad"])
    assert cost == pytest.approx(0.5 + HEADING_M_RAD * math.radians(30.0), abs=0.05)  # it moved
    assert reward == pytest.approx(-0.1 * cost - CHANGE_M_S * 0.05)
    assert not terminated
    _, reward, *_, info = env.step(action)
    cost = info["place_error_m"] + HEADING_M_RAD * abs(info["heading_error_rad"])
    assert reward == pytest.approx(-0.1 * cost)


@pytest.mark.parametrize(
    ("options", "speed"),
    [({"far_m": 0.05}, -1.0), ({"settings": {"start.x_m": -0.5}}, 1.0)],
    ids=["far from the place", "touching the person"],
)
def test_an_episode_terminates_and_costs_as_much_as_being_far_for_the_rest(make, options, speed):
    env = make(**options)
    env.reset()
    steps = []
    for _ in range(9):
        *step, info = env.step(np.array([speed, 0.0, 0.0], np.float32))
        steps.append((*step, info))
        if step[2]:
            break
    _, reward, terminated, truncated, info = steps[-1]
    assert (terminated, truncated) == (True, False)
    cost = info["place_error_m"] + HEADING_M_RAD * abs(info["heading_error_rad"])
    changed = CHANGE_M_S if len(steps) == 1 else 0.0
    left_s = 0.99 - info["time_s"]  # 100 ticks, from 0 on
    far_m = options.get("far_m", 3.0)
    assert reward == pytest.approx(-0.1 * cost - changed - far_m * left_s)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scenario": "senses"}, "sensor.kind = 'fused' must be 'pose'"),
        ({"scenario": "convoy"}, "drives one"),
        ({"settings": {"services": ["physics", "controller"]}}, "needs target"),
        ({"period_s": 0.015}, "period_s: 0.015 s is not a whole number of ticks"),
        ({"period_s": 0.0}, "at least a tick"),
        ({"far_m": -1.0}, "far_m = -1 must be above 0"),
        ({"settings": {"follower.standof_m": 1.0}}, "did you mean standoff_m"),
    ],
)
def test_what_can_not_be_used_is_said_in_one_line(options, said):
    with pytest.raises(ConfigError, match=said) as error:
        gymnasium.make(NAME, **options)
    assert "\n" not in str(error.value)
    assert "--set" not in str(error.value)
