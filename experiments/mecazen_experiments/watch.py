"""One run as an observer sees it: where everybody truly was, and when the robot saw its person."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.keys import PEOPLE, SKELETONS, TARGET_SKELETON
from mecazen.skeleton import INDEX, JOINTS
from mecazen_tools.simulate import InProcess

from mecazen_experiments.capture import collect
from mecazen_experiments.table import Floats, Poses, Table

PELVIS = INDEX["pelvis"]
SAME_M = 0.5
"""Somebody whose pelvis is reported so close to the person's is taken to be the person."""


class Body(NamedTuple):
    """Somebody over time."""

    joints: Floats
    """In the world (n, 20, 3) [m]; NaN where they are not there."""
    height: float


class Watched(NamedTuple):
    """What happened in a run."""

    table: Table
    """Robot and person at every tick."""
    t: Floats
    """Of bodies (n,) [s]."""
    robot: Poses
    """At these times, in the world."""
    person: Body
    others: tuple[Body, ...]
    frames: Floats
    """Times at which the camera took its frames (k,) [s]."""
    seen: npt.NDArray[np.bool_]
    """Whether they show the person (k,)."""


def watch(scenario: Scenario) -> Watched:
    """Simulate a scenario with one robot and a body tracker.

    Raises:
        MecazenError: The run failed, or there is no body tracker.
    """
    if "tracker" not in scenario.features:
        raise ConfigError("who is seen needs sensor.kind = 'body' or 'fused'")
    with closing(InProcess(scenario)) as run:
        bodies = collect(run.bus, TARGET_SKELETON)
        crowds = collect(run.bus, PEOPLE)
        frames = collect(run.bus, SKELETONS)
        for _ in run.ticks():
            pass
        table = Table.of(run.trajectory)
    t = np.array([body.header.stamp.ns / 1e9 for body in bodies])
    robot = Poses(*(column[_ticks(table, t)] for column in table.poses("robot")))
    person = Body(np.array([_joints(body.joints) for body in bodies]), bodies[0].height)
    taken = [frame for frame in frames if frame.header.stamp.ns]
    return Watched(
        table,
        t,
        robot,
        person,
        _others(crowds, t),
        np.array([frame.header.stamp.ns / 1e9 for frame in taken]),
        np.array([_shows(frame, table, t, person) for frame in taken], dtype=bool),
    )


def _ticks(table: Table, t: Floats) -> npt.NDArray[np.int64]:
    ticks: npt.NDArray[np.int64] = np.rint((t - table["t_s"][0]) / table.tick_s).astype(np.int64)
    return ticks


def _joints(points: Sequence[m.Point]) -> list[tuple[float, float, float]]:
    return [(point.x, point.y, point.z) for point in points]


def _others(crowds: Sequence[m.People], t: Floats) -> tuple[Body, ...]:
    """Return everybody but the robot's person; nobody where nobody is told of."""
    found: dict[str, Body] = {}
    for crowd in crowds:
        at = int(np.searchsorted(t, crowd.header.stamp.ns / 1e9 - 1e-6))
        for somebody in crowd.persons:
            if somebody.id == "target" or at >= len(t):
                continue
            nowhere = np.full((len(t), len(JOINTS), 3), np.nan)
            body = found.setdefault(somebody.id, Body(nowhere, somebody.height))
            body.joints[at] = _joints(somebody.joints)
    return tuple(found.values())


def _shows(frame: m.Skeletons, table: Table, t: Floats, person: Body) -> bool:
    """Return whether somebody in a frame is where the person was when it was taken."""
    taken = frame.header.stamp.ns / 1e9
    at = min(int(np.searchsorted(t, taken - 1e-6)), len(t) - 1)
    robot = table.poses("robot").at(int(_ticks(table, np.array([taken]))[0]))
    x, y, _ = person.joints[at, PELVIS]
    for body in frame.skeletons:
        if body.confidence and not body.confidence[PELVIS]:
            continue
        pelvis = body.joints[PELVIS]
        place = robot.compose(robot._replace(x=pelvis.x, y=pelvis.y, yaw=0.0))
        if np.hypot(place.x - x, place.y - y) < SAME_M:
            return True
    return False
