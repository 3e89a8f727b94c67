"""Many environments on a plane: Gymnasium's rules, and full physics as the measure."""

import hashlib
from typing import NamedTuple

import gymnasium
import mecazen_gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from mecazen.errors import ConfigError
from mecazen_gym.follow import FollowEnv
from mecazen_gym.surrogate import surrogate
from mecazen_tools.simulation import load

gymnasium.register_envs(mecazen_gym)

NAME = "mecazen/Follow-v0"
STILL = np.zeros(3, np.float32)
NOISELESS = {"sensor.position_std_m": 0.0, "sensor.yaw_std_deg": 0.0}


def make(num_envs=2, **options):
    return gymnasium.make_vec(
        NAME, num_envs, "vector_entry_point", **({"duration_s": 1.0} | options)
    )


def play(env, seed, steps=12, size=0.3):
    """Return observations, rewards and infos of random actions, alike in all environments."""
    observations, infos = [env.reset(seed=seed)[0]], []
    for action in np.random.default_rng(0).uniform(-size, size, (steps, 3)):
        observation, *values, info = env.step(np.tile(action, (env.num_envs, 1)))
        observations.append(observation)
        infos.append((*values, info))
    return np.array(observations), infos


class Alone(gymnasium.Env):
    """The only environment of a vector, for Gymnasium's checker: it has none for vectors."""

    def __init__(self):
        self.envs = make(1)
        self.observation_space = self.envs.single_observation_space
        self.action_space = self.envs.single_action_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        observations, infos = self.envs.reset(seed=seed, options=options)
        return observations[0], infos

    def step(self, action):
        observations, rewards, terminated, truncated, infos = self.envs.step(action[None])
        ends = bool(terminated[0]), bool(truncated[0])
        return observations[0], float(rewards[0]), *ends, infos


def test_gymnasiums_checker_and_wrappers_find_nothing():
    check_env(Alone(), skip_render_check=True)  # its warnings are errors here
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(make(3))
    *_, last = play(env, 1, steps=10)[1]
    assert last[-1]["episode"]["l"].tolist() == [10] * 3


@pytest.mark.parametrize("reward", ["place", "scores"])
def test_a_second_is_that_of_full_physics_without_noise(reward):
    options = {"settings": NOISELESS, "reward": reward, "period_s": 0.05}
    env, single = make(1, **options), FollowEnv(**options, duration_s=1.0)
    env.reset(seed=3)
    single.reset(seed=3)
    try:
        for action in np.random.default_rng(0).uniform(-0.3, 0.3, (19, 3)):
            observation, rewards, terminated, truncated, infos = env.step(action[None])
            expected, reward, *ends, info = single.step(action)
            # 1 mm and 0.2 deg: a tenth of what a period moves
            assert observation[0, :4] == pytest.approx(expected[:4], abs=3e-3)
            assert observation[0, 4:] == pytest.approx(expected[4:], abs=1e-3)
            assert rewards[0] == pytest.approx(reward, abs=3e-4)
            assert [terminated[0], truncated[0]] == ends
            assert infos["time_s"][0] == pytest.approx(info["time_s"])
            assert infos["robot"][0] == pytest.approx(info["robot"], abs=3e-3)
    finally:
        single.close()


def test_results_depend_on_the_seed_of_each_environment_alone():
    # also if another one slips, or its motors are slow
    vary = {"friction": (0.1, 1.0), "lag_s": (0.0, 0.1), "speed": (0.5, 2.0)}
    motors = {"delay_s": 0.02, "time_constant_s": 0.05, "gains": [1.0, 1.02, 0.99, 1.0]}
    options = {"vary": vary, "settings": {"robot.motors": motors}}
    observations, _ = play(make(3, **options), 7)
    alone, _ = play(make(1, **options), 8)
    assert np.array_equal(observations[:, 1], alone[:, 0])
    assert not np.array_equal(observations[:, 0], observations[:, 1])
    listed, _ = play(make(2, **options), [9, 7])
    assert np.array_equal(listed, observations[:, [2, 0]])


def test_the_next_step_after_an_end_begins_another_episode():
    env = make(2, settings={"start.x_m": -0.75}, vary={"speed": (1.0, 2.0)})
    env.reset(seed=1)
    toward, away = np.float32([1.0, 0.0, 0.0]), np.float32([0.0, 0.0, 0.0])
    ends = []
    for _ in range(8):
        _, rewards, terminated, truncated, infos = env.step(np.array([toward, away]))
        ends.append((bool(terminated[0]), float(infos["time_s"][0])))
        if terminated[0]:
            break
    assert ends[-1][0]
    # 3 m for each second that is left
    assert rewards[0] < -3.0 * (0.9 - ends[-1][1])
    observation, rewards, terminated, truncated, infos = env.step(np.array([toward, away]))
    assert (rewards[0], terminated[0], truncated[0], infos["time_s"][0]) == (0.0, False, False, 0.0)
    assert infos["robot"][0] == pytest.approx([-0.75, 0.0, 0.0])
    assert infos["time_s"][1] == pytest.approx(ends[-1][1] + 0.1)
    assert observation[0, 5:] == pytest.approx(np.zeros(6))


def test_sensors_have_the_scenarios_faults():
    settings = {"sensor.latency_s": 0.05, "sensor.fov_deg": 90.0, "sensor.dropout_probability": 0.5}
    env = make(1000, settings=settings)
    observation, _ = env.reset(seed=1)
    assert (observation[:, 4] == 10.0).all()  # nothing has arrived yet
    observation, *_ = env.step(np.zeros((1000, 3)))
    seen = observation[:, 4] < 10.0
    # the frame at 0.08 s was captured at 0.03 s; half are dropped, and no earlier one has arrived
    assert 450 < seen.sum() < 550
    assert observation[seen, 4] == pytest.approx(0.07)
    x, y = observation[seen, 0], observation[seen, 1]
    assert (x.mean(), x.std()) == (pytest.approx(1.0, abs=0.01), pytest.approx(0.05, rel=0.15))
    assert y.std() == pytest.approx(0.05, rel=0.15)
    turned = make(1, settings=settings | {"start.yaw_deg": 60.0, "sensor.dropout_probability": 0.0})
    turned.reset(seed=1)
    assert turned.step(STILL[None])[0][0, 4] == 10.0  # the person is out of view


class Job(NamedTuple):
    """A run of the study, of little more than a second."""

    seed: int
    settings: dict[str, object]

    def load(self):
        """Return the scenario."""
        return load("back", {"sim.duration_s": 1.1, "seed": self.seed, **self.settings})


@pytest.mark.parametrize(
    ("settings", "place_mm", "heading_deg"),
    [
        ({}, 0.5, 0.05),
        ({"services": ["physics", "controller", "target"]}, 3.0, 0.3),
        ({"robot.motors": {"delay_s": 0.02, "time_constant_s": 0.08}}, 1.0, 0.1),
    ],
    ids=["follower", "random", "real motors"],
)
def test_the_plane_is_near_full_physics_for_a_second(settings, place_mm, heading_deg):
    # three times what the study shows
    columns = surrogate(Job(1, settings))
    assert not columns["contact_1"]
    assert columns["all_1_mm"] < place_mm
    assert columns["all_1_deg"] < heading_deg
    assert columns["touched_all_1_mm"] is None
    without = "lag" if "robot.motors" in settings else "limits"
    assert columns[f"{without}_1_mm"] > 2.0 * columns["all_1_mm"]


def test_an_episode_has_the_same_bits_on_every_processor_and_python():
    settings = {
        "controller.limits.x.max_jerk_m_s3": 20.0,
        "controller.odometry_noise.x_m_s": 0.01,
        "robot.motors": {"delay_s": 0.02, "gains": [1.0, 1.02, 0.99, 1.0]},
        "sensor.faults.outlier_probability": 0.1,
        "sensor.fov_deg": 90.0,
        "sensor.latency_s": 0.05,
    }
    walks = [{"target.path.kind": "circle"}, {"target.path": {"kind": "wander", "number": 3}}]
    vary = {"friction": (0.1, 1.0), "lag_s": (0.0, 0.1), "mass": (0.5, 9.0), "speed": (0.5, 2.0)}
    env = make(16, settings=settings, walks=walks, vary=vary)
    digest = hashlib.sha256()
    for values in zip(*play(env, 3, steps=22, size=1.0), strict=False):
        observation, (reward, *_, info) = values
        for array in (observation, reward, info["robot"], info["person"], info["d_err_m"]):
            digest.update(array.tobytes())
    assert digest.hexdigest()[:16] == "fd89c618f46ef649"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"settings": {"services": ["physics", "controller", "target", "guard"]}},
            "guard does not",
        ),
        ({"settings": {"sensor.frame": "world"}}, "sensor.frame: the plane has only 'base_link'"),
        ({"settings": {"target.path.kind": "driven"}}, "'driven': the plane needs a path known"),
        ({"settings": {"robot.wheels.wiring": [2, 1, 3, 4]}}, "wiring: the plane has only"),
        ({"vary": {"frction": (0.5, 1.0)}}, "did you mean friction"),
        ({"vary": {"mass": (2.0, 1.0)}}, "must be 0 < low <= high"),
        ({"reward": "score"}, "allowed are 'place' and 'scores'"),
    ],
)
def test_what_the_plane_does_not_have_is_refused(options, message):
    with pytest.raises(ConfigError, match=message) as error:
        make(**options)
    assert "\n" not in str(error.value)


def test_wrong_actions_and_seeds_are_refused():
    env = make()
    with pytest.raises(ConfigError, match="seed"):
        env.reset(seed=[1, 2, 3])
    env.reset(seed=1)
    with pytest.raises(gymnasium.error.InvalidAction, match="each of 2"):
        env.step(STILL)
