"""The true motion of all people in a run, and the reports of the robot's body tracker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.keys import PEOPLE, SKELETONS, TARGET_SKELETON
from mecazen.skeleton import INDEX, JOINTS

from mecazen_experiments.capture import Motion, motion_of
from mecazen_experiments.run import observe_bodies
from mecazen_experiments.table import Floats, Poses, Table

PELVIS = INDEX["pelvis"]
SAME_M = 0.5
"""Maximum distance of a reported pelvis from the person's pelvis for a body to be the person."""


class PersonOverTime(NamedTuple):
    """A person over time."""

    joints: Floats
    """Joints in the world (n, 20, 3) [m]; NaN while the person is absent."""
    height: float


class Watched(NamedTuple):
    """The motion of robot and people in a run."""

    table: Table
    """Robot and person at every tick."""
    t: Floats
    """Times of the bodies (n,) [s]."""
    robot: Poses
    """Poses of the robot at these times, in the world."""
    person: PersonOverTime
    others: tuple[PersonOverTime, ...]
    truth: Motion
    """The person's joints in the world at the times of the bodies."""
    seen: Motion
    """The person's joints in odom at the times of the camera's frames, NaN in frames that do not
    show the person."""
    trajectory_sha256: str = ""


def watch(scenario: Scenario) -> Watched:
    """Simulate a scenario with one robot and a body tracker."""
    found = observe_bodies(scenario, PEOPLE)
    table = found.table
    bodies, crowds, frames = (
        found.samples[topic.key] for topic in (TARGET_SKELETON, PEOPLE, SKELETONS)
    )
    t = np.array([body.header.stamp.ns / 1e9 for body in bodies])
    robot = Poses(*(column[table.ticks(t)] for column in table.poses("robot")))
    person = PersonOverTime(np.array([_joints(body.joints) for body in bodies]), bodies[0].height)
    # frames taken before the start have no stamp
    taken = [frame for frame in frames if frame.header.stamp.ns]
    seen = motion_of([(frame.header, _shown(frame, table, t, person)) for frame in taken])
    odom = Poses(*(column[table.ticks(seen.t)] for column in table.poses("odom")))
    return Watched(
        table,
        t,
        robot,
        person,
        _others(crowds, t),
        motion_of([(body.header, body) for body in bodies]),
        seen.placed(odom),
        found.trajectory_sha256,
    )


def _joints(points: Sequence[m.Point]) -> list[tuple[float, float, float]]:
    return [(point.x, point.y, point.z) for point in points]


def _others(crowds: Sequence[m.People], t: Floats) -> tuple[PersonOverTime, ...]:
    """Return all reported people except the robot's person."""
    found: dict[str, PersonOverTime] = {}
    for crowd in crowds:
        at = int(np.searchsorted(t, crowd.header.stamp.ns / 1e9 - 1e-6))
        for somebody in crowd.persons:
            if somebody.id == "target" or at >= len(t):
                continue
            nowhere = np.full((len(t), len(JOINTS), 3), np.nan)
            body = found.setdefault(somebody.id, PersonOverTime(nowhere, somebody.height))
            body.joints[at] = _joints(somebody.joints)
    return tuple(found.values())


def _shown(
    frame: m.Skeletons, table: Table, t: Floats, person: PersonOverTime
) -> m.Skeleton | None:
    """Return the body of a frame that is at the person's position at the capture."""
    taken = frame.header.stamp.ns / 1e9
    at = min(int(np.searchsorted(t, taken - 1e-6)), len(t) - 1)
    robot = table.poses("robot").at(int(table.ticks(np.array([taken]))[0]))
    x, y, _ = person.joints[at, PELVIS]
    for body in frame.skeletons:
        if body.confidence and not body.confidence[PELVIS]:
            continue
        pelvis = body.joints[PELVIS]
        place = robot.compose(robot._replace(x=pelvis.x, y=pelvis.y, yaw=0.0))
        if np.hypot(place.x - x, place.y - y) < SAME_M:
            return body
    return None
