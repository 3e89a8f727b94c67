"""`mecazen/Follow-v0` for many robots at once, on a plane in place of full physics."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.explain import suggestion
from mecazen.geometry import Pose2D
from mecazen.portable import Floats
from mecazen_tools.simulation import load
from mecazen_tools.table import wrap

from mecazen_gym.follow import AGE_S, Array, Reward, Task
from mecazen_gym.planar import PlanarRobots
from mecazen_gym.sensing import (
    EPISODE,
    GOLDEN,
    LEVELS,
    NORMAL,
    ODOMETRY,
    Ints,
    Mask,
    Persons,
    PoseSensors,
    draw,
    scrambled,
    uniform,
)

VARIED = ("friction", "mass", "lag_s", "noise", "speed", "gain")
"""What `vary` can name; each axis has its own `gain`."""
ONLY: dict[str, object] = {
    "controller.odometry": "wheel",
    "controller.update_rate_hz": None,
    "physics.drive": "velocity",
    "sensor.frame": "base_link",
    "sensor.faults.noise_correlation_s": 0.0,
    "sensor.faults.other_m": 0.0,
    "sensors.encoders.counts_per_turn": 0,
    "world.solids": (),
    "world.ridges": (),
    "world.patches": (),
}
"""The only values of settings that the plane has."""

Values = tuple[Array, Floats, Mask, Mask, dict[str, Any]]


class FollowVectorEnv(VectorEnv[Array, Array, npt.NDArray[Any]]):
    """Many environments `mecazen/Follow-v0` on a plane: docs/gym.md.

    Spaces, reward and infos are those of `FollowEnv`. After the step in which an episode ends, the
    next step begins another one: `AutoresetMode.NEXT_STEP`.

    Args:
        num_envs: Number of environments.
        scenario: See `FollowEnv`, as for all options but these two.
        settings: See `FollowEnv`.
        period_s: See `FollowEnv`.
        duration_s: See `FollowEnv`.
        far_m: See `FollowEnv`.
        reward: See `FollowEnv`.
        walks: Settings of which each episode draws some, for other persons:
            `[{"target.path.kind": "circle"}, {"target.path": {"kind": "wander", "number": 7}}]`.
        vary: Ranges from which each episode draws: factors of the ground's `friction`, of the
            robot's `mass`, of the `gain` of each axis, of the `noise` of sensor and odometry and of
            the person's `speed`, and a time constant `lag_s` beside that of the motors [s].
        render_mode: Must be None.

    Raises:
        ConfigError: A setting can't be used; the message names the allowed values.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 - as in Gymnasium

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | PathLike[str] | Scenario = "back",
        settings: Mapping[str, Any] = {},
        *,
        period_s: float = 0.1,
        duration_s: float | None = None,
        far_m: float = 3.0,
        reward: Reward = "place",
        walks: Sequence[Mapping[str, Any]] = ({},),
        vary: Mapping[str, tuple[float, float]] = {},
        render_mode: None = None,
    ) -> None:
        self._task = task = Task(
            scenario,
            settings,
            period_s=period_s,
            duration_s=duration_s,
            far_m=far_m,
            reward=reward,
            render_mode=render_mode,
        )
        self.scenario, self.num_envs, self.scale = task.scenario, num_envs, task.scale
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        _check(self.scenario)
        self._vary = dict(_range(name, limits) for name, limits in vary.items())
        self._tick_s, self._last = self.scenario.sim.tick_s, self.scenario.sim.ticks - 1
        ticks = math.ceil(self._vary.get("speed", (1.0, 1.0))[1] * self._last) + 2
        scenarios = [load(self.scenario, walk) for walk in walks]
        self.robots = PlanarRobots(self.scenario, num_envs)
        self._persons = Persons(scenarios, ticks, num_envs)
        self._sensors = PoseSensors(self.scenario, num_envs, self._persons)
        self._walks = len(scenarios)
        noise = self.scenario.controller.odometry_noise
        self._odometry_std = np.array((noise.x_m_s, noise.y_m_s, noise.yaw_rad_s))[:, None]
        self._goal = self.scenario.follower.standoff.goal(Pose2D())
        self._seeds: Ints | None = None
        self._episodes = np.zeros(num_envs, np.int64)
        self._tick, self._done = np.zeros(num_envs, np.int64), np.zeros(num_envs, bool)
        self._past = np.zeros((self._sensors.past + 1, 3, num_envs))
        self._robot, self._person = np.zeros((3, num_envs)), np.zeros((3, num_envs))
        self._actions = np.zeros((num_envs, 3))
        self._scored, self._errors = np.zeros(num_envs), np.zeros((2, num_envs))

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in all environments.

        Args:
            seed: The first seed of consecutive ones, or a seed for each environment; an episode
                without a seed follows from the last seed of its environment.
            options: None are known.

        Raises:
            ConfigError: A seed is invalid.
        """
        super().reset(seed=seed if isinstance(seed, int) else None, options=options)
        self._seed(seed)
        self._begin(np.arange(self.num_envs))
        self._done[:] = False
        return self._observations(), self._infos()

    def step(self, actions: npt.ArrayLike) -> Values:
        """Drive for a period; environments whose episode has ended begin another one instead.

        Raises:
            InvalidAction: The actions are not three numbers for each environment.
        """
        last, self._actions = self._actions, self._valid(actions).clip(-1.0, 1.0)
        task, begin, ended = self._task, self._tick, self._done
        self._tick = np.minimum(begin + task.ticks, self._last)
        wanted = np.ascontiguousarray(self._actions.T) * np.array(self.scale)[:, None]
        poses = self.robots.drive(wanted, task.ticks)
        distance = self._take(begin, poses)
        history = np.concatenate((self._past, poses))
        everyone = np.arange(self.num_envs)
        newest = begin + task.ticks
        self._sensors.observe(everyone, begin, self._tick, history, newest)
        self._past = history[task.ticks :]
        place, heading = self._place_and_heading()
        time_s, (x, y, yaw) = self._tick * self._tick_s, (self._actions - last).T
        change: Floats = np.sqrt(x * x + y * y + yaw * yaw)
        seconds = np.asarray((self._tick - begin) * self._tick_s, float)
        rewards = task.rewarded(place, distance, heading, change, seconds)
        terminated = (place > task.far_m) | self._touches()
        rewards -= np.where(terminated, task.far_m * (task.end_s - time_s), 0.0)
        truncated = self._tick >= self._last
        if ended.any():
            self._begin(np.flatnonzero(ended))
            rewards[ended], terminated[ended], truncated[ended] = 0.0, False, False
        self._done = terminated | truncated
        return self._observations(), rewards, terminated, truncated, self._infos()

    def _valid(self, actions: npt.ArrayLike) -> Floats:
        shape = self.num_envs, 3
        try:
            values = np.asarray(actions, float)
        except (TypeError, ValueError):  # text, or rows of several lengths
            values = np.empty(0)
        if values.shape != shape or not np.isfinite(values).all():
            raise gymnasium.error.InvalidAction(f"actions are numbers of the shape {shape}")
        return values

    def _seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Set the seeds of the next episodes, or go on to the next episodes."""
        if self._seeds is None:
            self._seeds = self.np_random.integers(2**32, size=self.num_envs)
        self._episodes += 1
        if seed is None:
            return
        seeds = range(seed, seed + self.num_envs) if isinstance(seed, int) else seed
        if len(seeds) != self.num_envs:
            raise ConfigError(f"seed: {len(seeds)} seeds for num_envs = {self.num_envs}")
        for number in seeds:
            if number is not None and not 0 <= number < 2**32:
                raise ConfigError(f"seed = {number} must be between 0 and {2**32 - 1}")
        new = np.array([number is not None for number in seeds])
        self._seeds = np.where(new, [number or 0 for number in seeds], self._seeds)
        self._episodes[new] = 0

    def _begin(self, envs: Ints) -> None:
        """Begin the next episodes of some environments."""
        assert self._seeds is not None
        self._episodes[envs] += 1
        episodes = self._episodes[envs].astype(np.uint64)
        streams = scrambled(scrambled(self._seeds[envs].astype(np.uint64)) + episodes * GOLDEN)
        self._sensors.streams[envs] = streams
        drawn = np.concatenate([draw(streams, EPISODE, number) for number in range(3)])
        self._persons.walk[envs] = drawn[0] * self._walks // LEVELS

        def varied(name: str, numbers: Ints) -> Floats:
            low, high = self._vary.get(name, (1.0, 1.0))
            return low + (high - low) * uniform(numbers)

        friction, mass, lag, noise, speed = drawn[1:6]
        lag_s = varied("lag_s", lag) if "lag_s" in self._vary else np.zeros(len(envs))
        gain, grip = varied("gain", drawn[6:9]), varied("friction", friction)
        self.robots.reset(envs, gain, grip, varied("mass", mass), lag_s)
        self._sensors.noise[envs] = varied("noise", noise)
        if "speed" in self._vary:
            if self._persons.speed is None:
                self._persons.speed = np.ones(self.num_envs)
            self._persons.speed[envs] = varied("speed", speed)
        self._tick[envs], self._actions[envs] = 0, 0.0
        self._scored[envs], self._errors[:, envs] = 0, 0.0
        self._robot[:, envs] = self._past[-1][:, envs] = self.robots.pose[:, envs]
        self._person[:, envs] = self._persons.at(self._tick[envs], envs)
        self._sensors.reset(envs)
        before = np.full(self.num_envs, -1)
        self._sensors.observe(envs, before, self._tick, self._past, self._tick)

    def _take(self, begin: Ints, poses: Floats) -> Floats:
        """Take robots and persons at the end of the step; return the distances' errors [m]."""
        rows, envs = self._tick - begin - 1, np.arange(self.num_envs)
        is_whole = (rows == len(poses) - 1).all()
        self._robot = poses[-1] if is_whole else poses[rows, :, envs].T
        self._person = self._persons.at(self._tick)
        dx, dy = self._person[0] - self._robot[0], self._person[1] - self._robot[1]
        distance: Floats = np.sqrt(dx * dx + dy * dy) - self.scenario.follower.standoff.distance
        counts = self._persons.have_moved(self._tick)
        self._errors += counts * np.abs((distance, self._place_and_heading()[1]))
        self._scored += counts
        return distance

    def _place_and_heading(self) -> tuple[Floats, Floats]:
        """Return the distance of each robot from its place [m], and its heading error [rad]."""
        x, y, yaw = self._person
        c, s = np.cos(yaw), np.sin(yaw)
        goal_x, goal_y, goal_yaw = self._goal
        dx = self._robot[0] - (x + c * goal_x - s * goal_y)
        dy = self._robot[1] - (y + s * goal_x + c * goal_y)
        return np.sqrt(dx * dx + dy * dy), wrap(self._robot[2] - yaw - goal_yaw)

    def _touches(self) -> Mask:
        x, y, yaw = self._robot
        dx, dy = self._person[0] - x, self._person[1] - y
        c, s = np.cos(yaw), np.sin(yaw)
        return self._task.is_near(c * dx + s * dy, c * dy - s * dx)

    def _observations(self) -> Array:
        x, y, yaw = self._sensors.seen
        age_s = np.minimum((self._tick - self._sensors.seen_tick) * self._tick_s, AGE_S)
        twist = self.robots.measured
        if self._odometry_std.any():
            drawn = draw(self._sensors.streams, ODOMETRY, self._tick)[:3]
            twist = twist + NORMAL[drawn] * self._odometry_std * self._sensors.noise
        observations = np.empty((self.num_envs, 11), np.float32)
        columns = x, y, np.cos(yaw), np.sin(yaw), age_s, *twist, *self._actions.T
        for number, column in enumerate(columns):
            observations[:, number] = column
        return observations.clip(self._task.low, self._task.high)

    def _infos(self) -> dict[str, Any]:
        """Return the truth, as `FollowEnv` has it, in arrays (n, …), and which entries hold."""
        place, heading = self._place_and_heading()
        d_err, theta_err = self._errors / np.maximum(self._scored, 1.0)
        infos = {
            "time_s": self._tick * self._tick_s,
            "place_error_m": place,
            "heading_error_rad": heading,
            "robot": _poses(self._robot),
            "person": _poses(self._person),
            "d_err_m": d_err,
            "theta_err_deg": np.degrees(theta_err),
        }
        infos |= {f"_{name}": np.ones(self.num_envs, bool) for name in infos}
        infos["_d_err_m"] = infos["_theta_err_deg"] = self._scored > 0.0
        return infos


def _poses(columns: Floats) -> Floats:
    """Return poses (n, 3) of columns (3, n), with yaw wrapped."""
    poses = columns.T.copy()
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def _check(scenario: Scenario) -> None:
    """Refuse what the plane does not have.

    Raises:
        ConfigError: One line with the key, and what is allowed.
    """
    full = "; vectorization_mode='async' has full physics"
    for service in {*scenario.services} - {"physics", "controller", "target"}:
        raise ConfigError(f"services: {service} does not run on the plane{full}")
    for key, allowed in ONLY.items():
        value = functools.reduce(getattr, key.split("."), scenario)
        if value != allowed:
            raise ConfigError(f"{key}: the plane has only {allowed!r}{full}")
    if (motors := scenario.robot.motors) is not None and motors.dead_band_rad_s:
        raise ConfigError(f"robot.motors.dead_band_rad_s: the plane has only 0{full}")


def _range(name: str, limits: tuple[float, float]) -> tuple[str, tuple[float, float]]:
    if name not in VARIED:
        hint = suggestion(name, VARIED)
        raise ConfigError(f"vary: no {name!r}; {hint}allowed: {', '.join(VARIED)}")
    low, high = limits
    if not 0.0 <= low <= high < math.inf or (low == 0.0 and name in ("mass", "speed", "friction")):
        raise ConfigError(f"vary: {name} = ({low:g}, {high:g}) must be 0 < low <= high")
    return name, (float(low), float(high))
