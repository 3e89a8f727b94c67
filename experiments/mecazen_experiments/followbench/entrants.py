"""Planners by name: the reference, or a user's class or node of mecazen."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, cast

from mecazen import messages as m
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import CMD_VEL, ODOM, PEOPLE, SCAN, Topic
from mecazen.loading import load_scenario, scenario_path
from mecazen.loop import mapping_of
from mecazen.node import Inputs, Node, Tick
from mecazen.programs import imported
from mecazen.wire import NS_PER_S

from mecazen_experiments.followbench import robot
from mecazen_experiments.followbench.episodes import STEP_S
from mecazen_experiments.followbench.play import Planner, Seen, View
from mecazen_experiments.followbench.social import Social


def entrant(name: str) -> Callable[[], Planner]:
    """Return the maker of a planner: `social`, or `file.py:Class`.

    Raises:
        ConfigError: There is no such planner.
    """
    if name == "social":
        return Social
    if ":" not in name:
        raise ConfigError(f"follower = {name!r}: must be social, or file.py:Class")
    made = imported(name)
    if inspect.isclass(made) and issubclass(made, Node):
        return partial(NodePlanner, made)
    if inspect.isclass(made) and hasattr(made, "command"):
        return cast(Callable[[], Planner], made)
    raise ConfigError(
        f"follower = {name!r}: must be a class with command(view), or a mecazen.node.Node"
    )


class NodePlanner:
    """A follower node of mecazen: it receives odometry, people and scans, and publishes `cmd_vel`.

    The person to follow is named "target", and is absent while out of sight.
    """

    def __init__(self, made: type[Node]) -> None:
        self._node = made(load_scenario(scenario_path("back")))
        self._twist = Twist2D()

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._node.reset(seed)

    def command(self, view: View) -> tuple[float, float]:
        """Return the forward speed and yaw rate of the node's last `cmd_vel`."""
        number = round(view.time_s / STEP_S)
        tick = Tick(number, number * round(STEP_S * NS_PER_S), STEP_S)
        header = m.Header(stamp=tick.time, frame_id="odom")
        persons = [_person(f"walker_{n}", person) for n, person in enumerate(view.people, 1)]
        if view.target is not None:
            persons.insert(0, _person("target", view.target))
        twist = Twist2D(view.v, 0.0, view.w)
        samples: dict[Topic[Any], m.Message] = {
            ODOM: m.planar_odometry(tick.time, "odom", "base_link", view.robot, twist),
            PEOPLE: m.People(header, tuple(persons)),
            SCAN: m.LaserScan(
                header=m.Header(stamp=tick.time, frame_id="base_link"),
                angle_min=float(robot.ANGLES[0]),
                angle_max=float(robot.ANGLES[-1]),
                angle_increment=robot.APART,
                range_min=0.0,
                range_max=robot.RANGE,
                ranges=tuple(view.ranges.tolist()),
            ),
        }
        outputs = self._node.step(tick, Inputs(samples, now_ns=tick.time_ns))
        command = mapping_of("follower", outputs).get(CMD_VEL)
        if isinstance(command, m.Twist):
            self._twist = command.to_planar()
        return self._twist.x, self._twist.yaw


def _person(name: str, seen: Seen) -> m.Person:
    """Return a person as a message: a disc has no heading, so the twist is along the axes."""
    twist = m.Twist.planar(Twist2D(seen.vx, seen.vy))
    return m.Person(name, m.Pose.planar(Pose2D(seen.x, seen.y)), twist)
