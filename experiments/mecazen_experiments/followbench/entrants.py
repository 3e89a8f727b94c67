"""Makers of the planners in an episode: planners of this package, or a user's class."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.keys import CMD_VEL, ODOM, PEOPLE, SCAN, Topic
from mecazen.loading import load_scenario, scenario_path
from mecazen.loop import mapping_of
from mecazen.node import Inputs, Node, Tick
from mecazen.programs import imported
from mecazen.wire import NS_PER_S

from mecazen_experiments.followbench import sight
from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.planners import PLANNERS
from mecazen_experiments.followbench.view import Planner, Seen, View

STEP_NS = round(STEP_S * NS_PER_S)
NEAREST = 5
"""Number of people in the observation of a policy."""


class NodePlanner:
    """A follower node of mecazen: it receives odometry, people and scans, and publishes `cmd_vel`.

    The person to follow is named "target", and is absent while out of sight.
    """

    def __init__(self, made: type[Node], scenario: Scenario) -> None:
        self._node = made(scenario)
        self._twist = Twist2D()

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._node.reset(seed)

    def command(self, view: View) -> tuple[float, float]:
        """Return the forward speed and yaw rate of the node's last `cmd_vel`."""
        number = round(view.time_s / STEP_S)
        tick = Tick(number, number * STEP_NS, STEP_S)
        samples: dict[Topic[Any], m.Message] = {
            ODOM: _odometry(tick, view),
            PEOPLE: _people(tick, view),
            SCAN: _scan(tick, view),
        }
        outputs = self._node.step(tick, Inputs(samples, now_ns=tick.time_ns))
        command = mapping_of("follower", outputs).get(CMD_VEL)
        if isinstance(command, m.Twist):
            self._twist = command.to_planar()
        return self._twist.x, self._twist.yaw


class PolicyPlanner:
    """A policy of Gymnasium: `predict(observation)` returns the command as its first value."""

    def __init__(self, policy: Any) -> None:
        self._policy = policy

    def reset(self, seed: int) -> None:
        """Begin an episode, if the policy has a state."""
        if hasattr(self._policy, "reset"):
            self._policy.reset(seed)

    def command(self, view: View) -> tuple[float, float]:
        """Return the policy's action."""
        action, *_ = self._policy.predict(observation(view))
        v, w = np.asarray(action, dtype=float).ravel().tolist()
        return v, w


def observation(view: View) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the observation of a policy (234), in the frame of the robot's axle.

    The values are: v, w; 1 for the place beside the target, 0 for that behind it; the distance to
    keep; 1, position and velocity of the target, or zeros while unseen; the same for the five
    nearest people; the beams of the scan.
    """
    near = sorted(
        view.people, key=lambda one: (one.x - view.robot.x) ** 2 + (one.y - view.robot.y) ** 2
    )
    seen = [view.target, *near[:NEAREST]]
    seen += [None] * (1 + NEAREST - len(seen))
    rows = [_relative(view.robot, one) for one in seen]
    is_beside = float(view.place == "left_side")
    values = [view.v, view.w, is_beside, view.distance, *(v for row in rows for v in row)]
    return np.concatenate((values, view.ranges))


def entrant(name: str) -> Callable[[], Planner]:
    """Return the maker of a planner, by its name or `file.py:Class`.

    Raises:
        ConfigError: There is no such planner.
    """
    if name in PLANNERS:
        return PLANNERS[name]
    if ":" not in name:
        raise ConfigError(
            f"--follower {name}: no such planner; known: {', '.join(PLANNERS)}; or file.py:Class"
        )
    made = imported(name)
    if inspect.isclass(made) and issubclass(made, Node):
        scenario = load_scenario(scenario_path("back"))
        return lambda: NodePlanner(made, scenario)
    if inspect.isclass(made) and hasattr(made, "command"):
        return cast(Callable[[], Planner], made)
    if inspect.isclass(made) and hasattr(made, "predict"):
        return lambda: PolicyPlanner(made())
    raise ConfigError(
        f"--follower {name}: must be a class with command(view), a mecazen.node.Node, or a class "
        "with predict(observation)"
    )


def _relative(robot: Pose2D, one: Seen | None) -> tuple[float, ...]:
    if one is None:
        return (0.0,) * 5
    x, y = rotate(one.x - robot.x, one.y - robot.y, -robot.yaw)
    return (1.0, x, y, *rotate(one.vx, one.vy, -robot.yaw))


def _odometry(tick: Tick, view: View) -> m.Odometry:
    twist = Twist2D(view.v, 0.0, view.w)
    return m.planar_odometry(tick.time, "odom", "base_link", view.robot, twist)


def _people(tick: Tick, view: View) -> m.People:
    persons = [_person(f"walker_{n + 1}", one) for n, one in enumerate(view.people)]
    if view.target is not None:
        persons.insert(0, _person("target", view.target))
    return m.People(m.Header(stamp=tick.time, frame_id="odom"), tuple(persons))


def _person(name: str, one: Seen) -> m.Person:
    """Return a person as a message: a disc has no heading, so the twist is along the axes."""
    return m.Person(
        name, m.Pose.planar(Pose2D(one.x, one.y)), m.Twist.planar(Twist2D(one.vx, one.vy))
    )


def _scan(tick: Tick, view: View) -> m.LaserScan:
    return m.LaserScan(
        header=m.Header(stamp=tick.time, frame_id="base_link"),
        angle_min=float(sight.ANGLES[0]),
        angle_max=float(sight.ANGLES[-1]),
        angle_increment=sight.APART,
        range_min=0.0,
        range_max=sight.RANGE,
        ranges=tuple(view.ranges.tolist()),
    )
