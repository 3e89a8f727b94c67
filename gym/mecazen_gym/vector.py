"""`mecazen/Follow-v0` for many robots at once, on a plane in place of full physics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

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

from mecazen_gym.follow import AGE_S, Array, Task, valid
from mecazen_gym.planar import Ints, PlanarRobots, between
from mecazen_gym.sensing import (
    EPISODE,
    GOLDEN,
    NORMAL,
    ODOMETRY,
    Mask,
    Persons,
    PoseSensors,
    draw,
    scrambled,
    uniform,
)

VARIED: dict[str, Any] = {
    "friction": 1,
    "mass": 2,
    "lag_s": 3,
    "noise": 4,
    "speed": 5,
    "gain": slice(6, 9),
}
"""Names in `vary`, and their rows of an episode's random numbers; the first row is the walk's."""
ONLY = {
    "controller.odometry": "wheel",
    "controller.update_rate_hz": None,
    "physics.drive": "velocity",
    "robot.wheels.centre_m": (0.0, 0.0),
    "robot.wheels.mounting": (1, 2, 3, 4),
    "robot.wheels.wiring": (1, 2, 3, 4),
    "sensor.frame": "base_link",
    "sensor.faults.noise_correlation_s": 0.0,
    "sensor.faults.other_m": 0.0,
    "sensors.encoders.counts_per_turn": 0,
    "world.solids": (),
    "world.ridges": (),
    "world.patches": (),
}
"""The only values of settings that the plane has."""


class FollowVectorEnv(VectorEnv[Array, Array, npt.NDArray[Any]]):
    """Many environments `mecazen/Follow-v0` on a plane: docs/gym.md.

    Spaces, reward and infos are those of `FollowEnv`. After the step in which an episode ends, the
    next step begins another one: `AutoresetMode.NEXT_STEP`.

    Args:
        num_envs: Number of environments.
        scenario: The scenario.
        settings: Values that replace those of the scenario, by key.
        walks: Settings of which each episode draws some, for other persons:
            `[{"target.path.kind": "circle"}, {"target.path": {"kind": "wander", "number": 7}}]`.
        vary: Ranges from which each episode draws: factors of the ground's `friction`, of the
            robot's `mass`, of the `gain` of each axis, of the `noise` of sensor and odometry and of
            the person's `speed`, and a time constant `lag_s` beside that of the motors [s].
        options: Further options of `Task`.

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
        walks: Sequence[Mapping[str, Any]] = ({},),
        vary: Mapping[str, tuple[float, float]] = {},
        **options: Any,
    ) -> None:
        self.task = task = Task(scenario, settings, **options)
        self.scenario, self.num_envs, self.scale = task.scenario, num_envs, task.scale
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        _check(self.scenario)
        for name, (low, high) in vary.items():
            if name not in VARIED:
                hint = suggestion(name, VARIED)
                raise ConfigError(f"vary: no {name!r}; {hint}allowed: {', '.join(VARIED)}")
            is_positive = low > 0.0 or name not in ("mass", "speed", "friction")
            if not (0.0 <= low <= high < math.inf and is_positive):
                raise ConfigError(f"vary: {name} = ({low:g}, {high:g}) must be 0 < low <= high")
        self._vary = dict(vary)
        self._tick_s, self._last = self.scenario.sim.tick_s, self.scenario.sim.ticks - 1
        ticks = math.ceil(self._vary.get("speed", (1.0, 1.0))[1] * self._last) + 2
        self.robots = PlanarRobots(self.scenario, num_envs)
        self._walks = len(walks)
        self._persons = Persons([load(self.scenario, walk) for walk in walks], ticks, num_envs)
        self._sensors = PoseSensors(self.scenario, num_envs, self._persons)
        noise = self.scenario.controller.odometry_noise
        self._odometry_std = np.array((noise.x_m_s, noise.y_m_s, noise.yaw_rad_s))[:, None]
        self._goal = self.scenario.follower.standoff.goal(Pose2D())
        self._seeds: Ints | None = None
        self._episodes, self._tick = np.zeros(num_envs, np.int64), np.zeros(num_envs, np.int64)
        self._done, self._actions = np.zeros(num_envs, bool), np.zeros((num_envs, 3))
        self._history = np.zeros((self._sensors.past + 1 + task.ticks, 3, num_envs))
        """Poses of the robots at the newest ticks (rows, 3, n)."""
        self._robot, self._person = np.zeros((3, num_envs)), np.zeros((3, num_envs))
        self._scored, self._errors = np.zeros(num_envs), np.zeros((2, num_envs))

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in all environments.

        Args:
            seed: The first seed of consecutive ones, or the seed of each environment; episodes
                without a seed follow from the last one of their environment.
            options: None are known.

        Raises:
            ConfigError: A seed is invalid.
        """
        super().reset(seed=seed if isinstance(seed, int) else None, options=options)
        if seed is None and self._seeds is None:
            seed = self.np_random.integers(2**32, size=self.num_envs).tolist()
        if seed is not None:
            numbers = np.arange(self.num_envs)
            self._seeds = seed + numbers if isinstance(seed, int) else np.array(seed)
            if self._seeds.shape != numbers.shape:
                raise ConfigError(
                    f"seed: an integer, or one for each of {self.num_envs} environments"
                )
            if not ((self._seeds >= 0) & (self._seeds < 2**32)).all():
                raise ConfigError(f"seed = {seed} must be between 0 and {2**32 - 1}")
            self._episodes[:] = 0
        self._begin(np.arange(self.num_envs))
        self._done[:] = False
        return self._observations(), self._infos()

    def step(self, actions: npt.ArrayLike) -> tuple[Array, Floats, Mask, Mask, dict[str, Any]]:
        """Drive for a period; environments whose episode has ended begin another one instead.

        Raises:
            InvalidAction: The actions are not three numbers for each environment.
        """
        last, task, begin, ended = self._actions, self.task, self._tick, self._done
        self._actions = valid(actions, last.shape).clip(-1.0, 1.0)
        self._tick = np.minimum(begin + task.ticks, self._last)
        self._history[: -task.ticks] = self._history[task.ticks :]
        poses, newest = self._history[-task.ticks :], begin + task.ticks
        wanted = np.ascontiguousarray(self._actions.T) * np.array(self.scale)[:, None]
        self.robots.drive(wanted, poses)
        everyone = np.arange(self.num_envs)
        self._sensors.observe(everyone, begin, self._tick, self._history, newest)
        short = np.flatnonzero(self._tick < newest)
        self._robot[:] = poses[-1]
        self._robot[:, short] = poses[(self._tick - begin - 1)[short], :, short].T
        self._person = self._persons.at(self._tick)
        self._measured = place, distance, heading = self._measure()
        counts = self._persons.have_moved(self._tick)
        self._errors += counts * np.abs((distance, heading))
        self._scored += counts
        x, y, yaw = (self._actions - last).T
        change: Floats = np.sqrt(x * x + y * y + yaw * yaw)
        seconds = np.asarray((self._tick - begin) * self._tick_s, float)
        rewards = task.rewarded(place, distance, heading, change, seconds)
        ahead, beside, _ = between(self._robot, self._person)
        terminated = (place > task.far_m) | task.is_near(ahead, beside)
        left_s = task.end_s - self._tick * self._tick_s
        rewards -= np.where(terminated, task.far_m * left_s, 0.0)
        truncated = self._tick >= self._last
        if ended.any():
            self._begin(np.flatnonzero(ended))
            rewards[ended], terminated[ended], truncated[ended] = 0.0, False, False
        self._done = terminated | truncated
        return self._observations(), rewards, terminated, truncated, self._infos()

    def _begin(self, envs: Ints) -> None:
        """Begin the next episodes of some environments."""
        assert self._seeds is not None
        self._episodes[envs] += 1
        episodes = self._episodes[envs].astype(np.uint64)
        streams = scrambled(scrambled(self._seeds[envs].astype(np.uint64)) + episodes * GOLDEN)
        drawn = uniform(np.concatenate([draw(streams, EPISODE, number) for number in range(3)]))
        varied = {
            name: low + (high - low) * drawn[VARIED[name]]
            for name, (low, high) in self._vary.items()
        }
        self.robots.reset(envs, varied)
        walks = (drawn[0] * self._walks).astype(np.int64)
        self._persons.reset(envs, walks, varied.get("speed"))
        self._tick[envs], self._actions[envs] = 0, 0.0
        self._scored[envs], self._errors[:, envs] = 0.0, 0.0
        self._robot[:, envs] = self._history[-1][:, envs] = self.robots.pose[:, envs]
        self._person[:, envs] = self._persons.at(self._tick[envs], envs)
        self._sensors.reset(envs, streams, varied.get("noise"))
        before = np.full(self.num_envs, -1)
        self._sensors.observe(envs, before, self._tick, self._history, self._tick)
        self._measured = self._measure()

    def _measure(self) -> tuple[Floats, Floats, Floats]:
        """Return distances from the places [m], and errors of distance [m] and heading [rad]."""
        person_x, person_y, person_yaw = self._person
        robot_x, robot_y, robot_yaw = self._robot
        goal_x, goal_y, goal_yaw = self._goal
        c, s = np.cos(person_yaw), np.sin(person_yaw)
        dx, dy = robot_x - person_x, robot_y - person_y
        distance = np.sqrt(dx * dx + dy * dy) - self.scenario.follower.standoff.distance
        dx -= c * goal_x - s * goal_y
        dy -= s * goal_x + c * goal_y
        heading = wrap(robot_yaw - person_yaw - goal_yaw)
        return np.sqrt(dx * dx + dy * dy), distance, heading

    def _observations(self) -> Array:
        x, y, yaw = self._sensors.seen
        age_s = np.minimum((self._tick - self._sensors.seen_tick) * self._tick_s, AGE_S)
        twist = self.robots.measured
        if self._odometry_std.any():
            drawn = draw(self._sensors.streams, ODOMETRY, self._tick)[:3]
            twist = twist + NORMAL[drawn] * self._odometry_std * self._sensors.noise
        parts = (x, y, np.cos(yaw), np.sin(yaw), age_s, *twist, *self._actions.T)
        columns = np.array(parts, np.float32)
        low, high = self.task.low[:, None], self.task.high[:, None]
        return np.ascontiguousarray(columns.clip(low, high).T)

    def _infos(self) -> dict[str, Any]:
        """Return the truth, as `FollowEnv` has it, in arrays (n, …), and which entries hold."""
        place, _, heading = self._measured
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
        value: Any = scenario
        for name in key.split("."):
            value = getattr(value, name)
        if value != allowed:
            raise ConfigError(f"{key}: the plane has only {allowed!r}{full}")
