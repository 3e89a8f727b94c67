"""Plays an episode by the rules of Follow-Bench 1.0, and computes its metrics.

First the robot moves, then the target, then the others. The planner gets the true places of the
people in sight, and a scan. The first contact ends an episode; the rest of it counts as out of
sight and outside of every zone. Metrics are those of the code of Follow-Bench, which records a row
after each step: the start is not a row, and the first step adds no path length.
"""

from __future__ import annotations

import math
from itertools import groupby
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D
from mecazen.portable import Floats

from mecazen_experiments.followbench import robot
from mecazen_experiments.followbench.episodes import STEP_S, Episode, Place
from mecazen_experiments.followbench.people import People

RADII_M = math.hypot(*robot.HALF) + robot.PERSON_RADIUS
"""Sum of the radius of the circle around the robot's outline and the radius of a person [m]."""
PRIVATE_M, PERSONAL_M = 0.45, 1.2
"""Outer radii of the private and the personal zone of a person [m], after E. T. Hall, 1966."""


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


def metrics(record: Record, episode: Episode) -> dict[str, bool | float]:
    """Return the metrics of an episode; shares in percent.

    `asr` is true without contact, `sr` if the target was also never out of sight for too long.
    `tvr` is the share of the longest possible episode with the target visible, `tin_tperson` in the
    target's personal zone outside of the private zone, and `tin_private` in the private zone of
    another person. `pl_m` is the length of the axle's path, `search_s` the time without the target.
    """
    places, target, visible = record.robot[1:, :2], record.target[1:], record.visible[1:]
    free = np.hypot(*(target - places).T) - RADII_M
    distances = np.hypot(*np.moveaxis(record.humans[1:] - places[:, None], -1, 0))
    nearest = distances.min(axis=1, initial=np.inf) - RADII_M
    velocity = velocities(record)
    acceleration = np.diff(velocity, axis=0, prepend=velocity[:1]) / STEP_S
    jerk = np.diff(velocity, n=2, axis=0, prepend=velocity[:2]) / STEP_S**2
    searches = [len([*steps]) for seen, steps in groupby(visible.tolist()) if not seen]

    def share(steps: npt.NDArray[np.bool_]) -> float:
        return 100.0 * int(np.count_nonzero(steps)) / episode.max_steps

    return {
        "sr": not record.collided and max(searches, default=0) <= episode.max_search_steps,
        "asr": not record.collided,
        "tvr": share(visible),
        "tin_tperson": share((free > PRIVATE_M) & (free < PERSONAL_M)),
        "tin_private": share(nearest < PRIVATE_M),
        "pl_m": float(np.hypot(*np.diff(places, axis=0).T).sum()),
        "avg_vel_m_s": _mean_norm(velocity),
        "avg_acc_m_s2": _mean_norm(acceleration),
        "jerk_m_s3": _mean_norm(jerk),
        "search_s": float(np.count_nonzero(~visible) * STEP_S),
    }


def velocities(record: Record) -> Floats:
    """Return the velocity (n, 2) [m/s] of the axle in the world in each step.

    The code of Follow-Bench combines the speed of a step with the heading after the step; the robot
    moves along the heading before the step.
    """
    before, after = record.robot[:-1, 2], record.robot[1:, 2]
    dx, dy = np.diff(record.robot[:, :2], axis=0).T / STEP_S
    speed = np.cos(before) * dx + np.sin(before) * dy
    return np.stack((speed * np.cos(after), speed * np.sin(after)), axis=1)


def _mean_norm(vectors: Floats) -> float:
    """Return the mean length of vectors (n, 2), or 0 if n is 0: a run of one step has no jerk."""
    return float(np.hypot(*vectors.T).mean()) if len(vectors) else 0.0
