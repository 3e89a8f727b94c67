"""`mecazen/Follow-v0`: actions drive the robot, in the follower's place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, NamedTuple, TypeVar, get_args

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from gymnasium.utils import EzPickle
from mecazen import keys
from mecazen.arrays import to_rectangle
from mecazen.config import Scenario
from mecazen.drive import Drive
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.messages import Message, Odometry
from mecazen.messages import Observation as Frame
from mecazen.ticks import whole_ticks
from mecazen.wire import NS_PER_S
from mecazen_tools.simulation import Simulation, State, load
from msgspec.structs import replace

Array = npt.NDArray[np.float32]
Number = TypeVar("Number", float, npt.NDArray[np.float64])

HEADING_M_RAD = 0.5
"""Cost of a heading error, expressed as a position error [m/rad]."""
CHANGE_M_S = 0.01
"""Cost of a change of the action by 1 [m/s]."""
AGE_S = 10.0
"""Highest age in an observation [s]."""


class Observation(NamedTuple):
    """The entries of an observation, in their order: what a follower knows, without the truth."""

    person_x_m: float
    """The person's position in base_link when the sensor last saw them, with the sensor's noise;
    until then, the position at which the robot would be in its place."""
    person_y_m: float
    person_cos: float
    """Cosine and sine of the person's heading minus the robot's."""
    person_sin: float
    age_s: float
    """Time since the sensor last saw the person, at most `AGE_S`; `AGE_S` if it never has."""
    vx_m_s: float
    """The robot's twist by its odometry, in base_link."""
    vy_m_s: float
    yaw_rate_rad_s: float
    action_x: float
    """The last action."""
    action_y: float
    action_yaw: float

    @property
    def person(self) -> Pose2D:
        """The person's pose in base_link, as last seen."""
        yaw = math.atan2(self.person_sin, self.person_cos)
        return Pose2D(self.person_x_m, self.person_y_m, yaw)


Reward = Literal["place", "scores"]
"""Kinds of reward: by place, heading and smoothness, or by the errors of D_err and Θ_err."""


class Task:
    """The options of the environments, their spaces and their reward: docs/gym.md.

    Args:
        scenario: A name, a TOML file, or a loaded scenario; its follower does not run, and its
            section `follower` has the place to keep.
        settings: Values that replace those of the scenario, by key: `{"follower.standoff_m": 1.5}`.
        period_s: Simulated time of a step; whole ticks.
        duration_s: Simulated time after which an episode is truncated; the scenario's if left out.
        far_m: Distance of the robot from its place beyond which an episode terminates [m].
        reward: `"place"`: minus the errors of place and heading, and the change of the action;
            `"scores"`: minus the errors whose means are D_err and Θ_err.

    Raises:
        ConfigError: A setting can't be used; the message names the allowed values.
    """

    def __init__(
        self,
        scenario: str | PathLike[str] | Scenario = "back",
        settings: Mapping[str, Any] = {},
        *,
        period_s: float = 0.1,
        duration_s: float | None = None,
        far_m: float = 3.0,
        reward: Reward = "place",
    ) -> None:
        if duration_s is not None:
            settings = {**settings, "sim.duration_s": duration_s}
        self.scenario = _without_follower(load(scenario, settings))
        self.follower = self.scenario.follower
        self.ticks = whole_ticks("period_s", period_s, self.scenario.sim.tick_s)
        if self.ticks < 1:
            raise ConfigError(f"period_s = {period_s:g} must be at least a tick")
        if not far_m > 0.0:
            raise ConfigError(f"far_m = {far_m:g} must be above 0")
        if reward not in get_args(Reward):
            allowed = " and ".join(map(repr, get_args(Reward)))
            raise ConfigError(f"reward = {reward!r}: allowed are {allowed}")
        self.period_s, self.reward, self.far_m = period_s, reward, far_m
        self.end_s = (self.scenario.sim.ticks - 1) * self.scenario.sim.tick_s
        """Time of the last tick [s]."""
        drive = Drive.from_scenario(self.scenario)
        gains = 1.0, drive.sideways, drive.lever
        self.scale = Twist2D(
            *(
                min(axis.velocity, drive.rim_speed / gain)
                for axis, gain in zip(drive.axes, gains, strict=True)
            )
        )
        reach = self.scenario.sensor.max_range_m
        speeds = [2.0 * speed for speed in self.scale]  # a skidding wheel may report more
        self.high = np.array([reach, reach, 1, 1, AGE_S, *speeds, 1, 1, 1], np.float32)
        self.low = -self.high
        self.low[Observation._fields.index("age_s")] = 0.0
        self.observation_space = Box(self.low, self.high)
        self.action_space = Box(-1.0, 1.0, (3,), np.float32)

    def rewarded(
        self, place: Number, distance: Number, heading: Number, change: Number, seconds: Number
    ) -> Number:
        """Return the reward of a step of some `seconds`, for numbers or arrays.

        At its end the robot is away from its `place` [m], and has errors of the `distance` from the
        person [m] and of the `heading` [rad]; `change` is the size of that of the action.
        """
        if self.reward == "scores":
            return -seconds * (abs(distance) + HEADING_M_RAD * abs(heading))
        return -seconds * (place + HEADING_M_RAD * abs(heading)) - CHANGE_M_S * change

    def is_near(self, ahead: npt.ArrayLike, beside: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return whether the rectangle that holds the robot reaches a person at x, y in base_link.

        The arguments have any shape [m].
        """
        gaps = to_rectangle(ahead, beside, self.scenario.robot.footprint)
        near: npt.NDArray[np.bool_] = gaps <= self.scenario.world.person.radius_m
        return near


class Sight:
    """The knowledge of a policy in a run: the person as last seen, and the robot's odometry.

    The person is unseen until `look` gets a frame; they are then where the robot's place is.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._seen, self._seen_s = task.follower.standoff.person(Pose2D()), -math.inf
        self._odom = Odometry()

    def look(self, odom: Odometry, frame: Message | None) -> None:
        """Take the odometry of a tick, and the newest frame if it shows the person."""
        self._odom = odom
        if not isinstance(frame, Frame) or not frame.poses:
            return
        pose = frame.poses[0].pose.to_planar()
        in_base_link = frame.header.frame_id == "base_link"
        self._seen = pose if in_base_link else odom.pose.pose.to_planar().between(pose)
        self._seen_s = frame.header.stamp.ns / NS_PER_S

    def observation(self, time_s: float, action: Sequence[float]) -> Array:
        """Return the observation at a time [s] after an action."""
        x, y, yaw = self._seen
        c, s, age_s = math.cos(yaw), math.sin(yaw), time_s - self._seen_s
        twist = self._odom.twist.twist.to_planar()
        observation = Observation(x, y, c, s, age_s, *twist, *action)
        return np.array(observation, np.float32).clip(self._task.low, self._task.high)


class FollowEnv(gymnasium.Env[Array, Array], EzPickle):
    """An environment in which a robot is to keep its place beside a walking person: docs/gym.md.

    An action is the twist of base_link (x, y, yaw), where 1 is `scale`. It holds for `period_s`.
    A copy, by `pickle` or `deepcopy`, is a new environment with the same options, those of `Task`.

    Attributes:
        scenario: The whole configuration, without the follower.
        follower: The follower's section.
        scale: The twist of the action (1, 1, 1): the most that wheels and controller allow.
        sim: The simulation, for quantities that are not in an observation.
    """

    def __init__(
        self,
        scenario: str | PathLike[str] | Scenario = "back",
        settings: Mapping[str, Any] = {},
        **options: Any,
    ) -> None:
        EzPickle.__init__(self, scenario, settings, **options)
        self.task = task = Task(scenario, settings, **options)
        self.scenario, self.follower, self.scale = task.scenario, task.follower, task.scale
        self.observation_space, self.action_space = task.observation_space, task.action_space
        self.sim = Simulation(self.scenario)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; `seed` is the scenario's seed, which determines the noise.

        Raises:
            ConfigError: The seed is invalid.
        """
        super().reset(seed=seed, options=options)
        state = self.sim.reset(int(self.np_random.integers(2**32)) if seed is None else seed)
        self._action = np.zeros(3)
        self._sight = Sight(self.task)
        self._start, self._scored = state.person, 0
        self._errors = np.zeros(2)
        """Sums of the errors of D_err and Θ_err [m, rad]."""
        self._look()
        return self._sight.observation(self.sim.time_s, self._action.tolist()), self._info(state)

    def step(self, action: npt.ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Drive for a period.

        Raises:
            InvalidAction: The action is not three numbers.
        """
        last, self._action = self._action, valid(action, (3,)).clip(-1.0, 1.0)
        self.sim.command(*(self._action * self.scale).tolist())
        begin_s = self.sim.time_s
        for _ in self.sim.ticks(self.task.period_s):
            self._look()
            robot, person = (
                self.sim.latest(topic.key) for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM)
            )
            assert isinstance(robot, Odometry)
            assert isinstance(person, Odometry)
            place = person.pose.pose.to_planar()
            if self._scored or place != self._start:  # the scores begin when the person moves
                error = self.follower.standoff.errors(place, robot.pose.pose.to_planar())
                self._errors += abs(error.distance), abs(error.yaw)
                self._scored += 1
        state, task = self.sim.state, self.task
        info = self._info(state)
        assert state.person is not None  # target takes part
        place_m, seconds = info["place_error_m"], state.time_s - begin_s
        distance_m, _, heading_rad = self.follower.standoff.errors(state.person, state.robot)
        change = math.hypot(*(self._action - last))
        reward = task.rewarded(place_m, distance_m, heading_rad, change, seconds)
        ahead, beside, _ = state.robot.between(state.person)
        terminated = place_m > task.far_m or bool(task.is_near(ahead, beside))
        if terminated:
            reward -= task.far_m * (task.end_s - state.time_s)
        return (
            self._sight.observation(self.sim.time_s, self._action.tolist()),
            reward,
            terminated,
            self.sim.is_over,
            info,
        )

    def action(self, twist: Twist2D) -> Array:
        """Return the action that commands a twist of base_link as closely as possible."""
        return (np.array(twist) / self.scale).clip(-1.0, 1.0).astype(np.float32)

    def close(self) -> None:
        """End the simulation."""
        self.sim.close()

    def _look(self) -> None:
        odom = self.sim.latest(keys.ODOM.key)
        assert isinstance(odom, Odometry)  # published from the first tick on
        self._sight.look(odom, self.sim.latest(keys.OBSERVATION.key))

    def _info(self, state: State) -> dict[str, Any]:
        """Return the truth: time, errors, poses in world, and the scores since the reset."""
        assert state.person is not None  # target takes part
        goal = self.follower.standoff.goal(state.person)
        info = {
            "time_s": state.time_s,
            "place_error_m": state.robot.distance(goal),
            "heading_error_rad": wrap(state.robot.yaw - goal.yaw),
            "robot": np.array(state.robot),
            "person": np.array(state.person),
        }
        if self._scored:
            distance, heading = self._errors.tolist()
            info["d_err_m"] = distance / self._scored
            info["theta_err_deg"] = math.degrees(heading / self._scored)
        return info


def valid(actions: npt.ArrayLike, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Return actions as finite numbers of a shape (…, 3).

    Raises:
        InvalidAction: They are none.
    """
    try:
        values = np.asarray(actions, float)
    except (TypeError, ValueError):  # text, or rows of several lengths
        values = np.empty(0)
    if values.shape != shape or not np.isfinite(values).all():
        rows = "" if len(shape) == 1 else f" for each of {shape[0]} environments"
        raise gymnasium.error.InvalidAction(
            f"an action is three numbers{rows}, got {actions!r:.80}"
        )
    return values


def _without_follower(scenario: Scenario) -> Scenario:
    if scenario.robots:
        raise ConfigError("robots: mecazen/Follow-v0 drives one, and there are several")
    if scenario.sensor.kind != "pose":
        raise ConfigError(
            f"sensor.kind = {scenario.sensor.kind!r} must be 'pose': what perceives with others "
            "is the follower's, which is left out"
        )
    for needed in ("physics", "controller", "target"):
        if needed not in scenario.services:
            raise ConfigError(f"services: mecazen/Follow-v0 needs {needed}")
    return replace(
        scenario,
        services=tuple(name for name in scenario.services if name != "follower"),
        programs={k: v for k, v in scenario.programs.items() if k != "follower"},
    )
