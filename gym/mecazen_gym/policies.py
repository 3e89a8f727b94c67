"""Policies for comparison: each uses only the observations of `mecazen/Follow-v0`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

from mecazen.config.follower import PidControl
from mecazen.drive import Drive
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.programs import imported
from mecazen_follower.following import Following
from mecazen_follower.measurement import Measurement
from mecazen_follower.node import data_sheet, view_of
from mecazen_follower.pid import PoseController
from mecazen_follower.tracking import Frame
from msgspec.structs import replace

from mecazen_gym.follow import Array, FollowEnv, Observation

Policy = Callable[[Array], Array]
"""Takes each observation of one episode, from the start, and returns an action."""


def random(env: FollowEnv, seed: int) -> Policy:
    """Return a policy of uniformly random actions."""
    space = env.action_space
    space.seed(seed)
    return lambda _: space.sample()


def pid(env: FollowEnv, _: int) -> Policy:
    """Drive by the follower's three PIDs to the place beside the person as last seen.

    There is no estimator, so no velocity to feed forward. The robot stops once no person is
    seen for `lost_after_s`.
    """
    law = PoseController(PidControl(feed_forward=False))

    def act(observation: Array) -> Array:
        seen = Observation(*observation.tolist())
        if seen.age_s > env.follower.lost_after_s:
            return env.action(law.stop())
        goal = env.follower.standoff.goal(seen.person)
        return env.action(law.command(goal, Twist2D(), Pose2D(), env.period_s))

    return act


class Follower:
    """The follower's own estimator and control law, run once per step of the environment.

    The pose of the robot is integrated from the odometry's twists, one for each step.
    """

    def __init__(self, env: FollowEnv, seed: int) -> None:
        del seed
        config, sensor = replace(env.follower, planner=None), data_sheet(env.scenario)
        view = view_of(env.scenario, sensor, config)
        self._following = Following(config, sensor, Drive.from_scenario(env.scenario), view)
        of_place, of_yaw = sensor.position_std_m**2, math.radians(sensor.yaw_std_deg) ** 2
        self._covariance = (of_place, 0.0, 0.0), (0.0, of_place, 0.0), (0.0, 0.0, of_yaw)
        self._env = env
        self._time_s = 0.0
        self._robot = Pose2D()

    def __call__(self, observation: Array) -> Array:
        """Return the action."""
        seen, dt = Observation(*observation.tolist()), self._env.period_s
        twist = Twist2D(seen.vx_m_s, seen.vy_m_s, seen.yaw_rate_rad_s)
        self._robot = self._robot.integrate(twist, dt)
        self._time_s += dt
        frame = None
        # half a tick: ages are rounded to 32 bits
        is_new = seen.age_s < dt - self._env.scenario.sim.tick_s / 2
        if is_new:
            at_capture = self._robot.integrate(twist, -seen.age_s)
            measured = Measurement(at_capture.compose(seen.person), self._covariance)
            frame = Frame(self._time_s - seen.age_s, [measured])
        return self._env.action(self._following.step(self._time_s, dt, self._robot, frame).command)


POLICIES: dict[str, Callable[[FollowEnv, int], Policy]] = {
    "random": random,
    "pid": pid,
    "follower": Follower,
}
"""Constructors by name; each makes a policy for one episode, from the episode's seed."""


def policy(name: str) -> Callable[[FollowEnv, int], Policy]:
    """Return the constructor of a policy: one of `POLICIES`, or `file.py:Class` of a user.

    Raises:
        ConfigError: There is no such policy.
    """
    if name in POLICIES:
        return POLICIES[name]
    found = imported(name) if ":" in name else None
    if not callable(found):
        allowed = ", ".join(POLICIES)
        raise ConfigError(f"{name}: no policy; allowed: {allowed}, or file.py:Class of your own")
    return cast(Callable[[FollowEnv, int], Policy], found)
