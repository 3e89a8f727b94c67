"""Plays an episode by the rules of Follow-Bench: first the robot moves, then the target and others.

The planner gets the true places of the people in sight, and a scan. The first contact ends an
episode.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D
from mecazen.portable import Floats

from mecazen_experiments.followbench import robot
from mecazen_experiments.followbench.episodes import STEP_S, Episode, Place
from mecazen_experiments.followbench.people import People


class Seen(NamedTuple):
    """Position [m] and velocity [m/s] of a person that the robot sees, in the world."""

    x: float
    y: float
    vx: float
    vy: float


class View(NamedTuple):
    """The input of a planner in one step."""

    time_s: float
    robot: Pose2D
    """Pose of the rear axle in the world."""
    v: float
    """Current speed [m/s]."""
    w: float
    """Current yaw rate [rad/s]."""
    target: Seen | None
    """The target; None while it is out of sight."""
    people: tuple[Seen, ...]
    """The visible people besides the target."""
    ranges: Floats
    """Distances (200) [m] from the axle, counter-clockwise from -180° to 180° relative to the
    robot's heading; 5 m if a beam hits nothing."""
    place: Place


class Planner(Protocol):
    """A follower: one command per step."""

    def reset(self, seed: int) -> None:
        """Forget the last episode, and seed random numbers."""

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""


class Record(NamedTuple):
    """The course of an episode: row 0 is the start, row k the state after step k."""

    robot: Floats
    """Poses of the rear axle (k, 3)."""
    target: Floats
    """Places of the target (k, 2) [m]."""
    humans: Floats
    """Places of the others (k, n, 2) [m]."""
    visible: npt.NDArray[np.bool_]
    """Whether the target is visible (k)."""
    collided: bool
    """Whether the last step ended in a contact."""


def play(episode: Episode, planner: Planner, seed: int) -> Record:
    """Play an episode, and return its record."""
    people, unicycle, known = People(episode), robot.Unicycle(episode.robot), robot.KnownArea()
    boxes: Floats = np.array(episode.boxes).reshape(-1, 5)
    ranges: Floats = np.full(robot.BEAMS, robot.RANGE)
    planner.reset(seed)
    sight = known.sees(unicycle.pose, people.places)
    poses, places, visible = [unicycle.pose], [people.places], [sight[0]]
    touches = False
    while not touches and len(poses) <= episode.max_steps:
        target, *humans = (Seen(p.real, p.imag, v.real, v.imag) for p, v in people.states)
        view = View(
            time_s=(len(poses) - 1) * STEP_S,
            robot=unicycle.pose,
            v=unicycle.v,
            w=unicycle.w,
            target=target if sight[0] else None,
            people=tuple(human for human, seen in zip(humans, sight[1:], strict=True) if seen),
            ranges=ranges,
            place=episode.place,
        )
        unicycle = unicycle.step(*planner.command(view), episode.size)
        # contacts and the scan are those after the robot's move, before people move
        touches = robot.touches(unicycle.pose, people.places, boxes)
        ranges = robot.scan(unicycle.pose, people.places, boxes)
        known.update(ranges)
        people.step(unicycle)
        sight = known.sees(unicycle.pose, people.places)
        poses.append(unicycle.pose)
        places.append(people.places)
        visible.append(sight[0])
    walks = np.array(places)
    return Record(np.array(poses), walks[:, 0], walks[:, 1:], np.array(visible), touches)
