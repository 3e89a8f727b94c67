"""Whole runs in this process, with all samples of some topics, and the motion of all people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.keys import PEOPLE, SKELETONS, TARGET_SKELETON, Topic
from mecazen.skeleton import INDEX, JOINTS

from mecazen_tools.simulation import Simulation
from mecazen_tools.table import Bools, Floats, Poses, Table

PELVIS = INDEX["pelvis"]
SAME_M = 0.5
"""Maximum distance of a reported pelvis from the person's pelvis for a body to be the person."""

Samples = Mapping[str, list[Any]]
"""All messages on topics so far, by the topics' keys."""
Drive = Callable[[int, Samples], Mapping[str, bytes]]
"""Returns the payloads in JSON to publish in a tick, by key, given its number and all samples so
far."""


class Observed(NamedTuple):
    """A finished run: all ticks, and all samples of some topics."""

    table: Table
    trajectory_sha256: str
    """Hash of the trajectory, as in `mecazen simulate --json`."""
    samples: Samples


def observe(scenario: Scenario, *topics: Topic[Any], drive: Drive = lambda *_: {}) -> Observed:
    """Simulate a scenario, and keep all samples of some topics.

    Args:
        scenario: The scenario to simulate.
        topics: The topics.
        drive: Returns the payloads to publish in each tick except the last.
    """
    with Simulation(scenario) as sim:
        samples = collect(sim, *topics, drive=drive)
        sim.trajectory.refuse_incomplete()
        return Observed(sim.trajectory.table(), sim.trajectory.sha256(), samples)


def collect(sim: Simulation, *topics: Topic[Any], drive: Drive = lambda *_: {}) -> Samples:
    """Simulate a whole run, driven as in `observe`; return all samples of some topics."""
    samples: dict[str, list[Any]] = {topic.key: [] for topic in topics}
    for topic in topics:
        sim.bus.subscribe(topic, partial(_keep, samples[topic.key]))
    sim.reset()  # with the samples of the first tick
    for tick in range(1, sim.scenario.sim.ticks):
        for key, payload in drive(tick, samples).items():
            sim.bus.put_bytes(key, payload)
        sim.step()
    return samples


def _keep(samples: list[Any], message: Any, _: object) -> None:
    samples.append(message)


def observe_bodies(scenario: Scenario, *topics: Topic[Any]) -> Observed:
    """Simulate a scenario that has a body tracker; see `observe`."""
    if "tracker" not in scenario.features:
        raise ConfigError("no body tracker: this needs sensor.kind = 'body' or 'fused'")
    return observe(scenario, TARGET_SKELETON, SKELETONS, *topics)


class PersonOverTime(NamedTuple):
    """A person over time."""

    joints: Floats
    """Joints in the world (n, 20, 3) [m]; NaN while the person is absent."""
    height: float


class Watched(NamedTuple):
    """The motion of robot and people in a run, and the camera's frames."""

    table: Table
    """Robot and person at every tick."""
    t: Floats
    """Times of the bodies (n,) [s]."""
    robot: Poses
    """Poses of the robot at these times, in the world."""
    person: PersonOverTime
    pedestrians: tuple[PersonOverTime, ...]
    bodies: Sequence[m.Skeleton]
    """The person's body at these times, in the world."""
    frames: Sequence[tuple[m.Header, m.Skeleton | None]]
    """Each frame of the camera: the person's body in the robot's frame, or None if the frame does
    not show the person."""
    trajectory_sha256: str = ""

    @property
    def sight(self) -> tuple[Floats, Bools]:
        """Times of the frames (k,) [s], and whether each shows the person (k,)."""
        times = np.array([header.stamp.ns / 1e9 for header, _ in self.frames])
        return times, np.array([body is not None for _, body in self.frames], dtype=bool)


def watch(scenario: Scenario) -> Watched:
    """Simulate a scenario with one robot and a body tracker."""
    run = observe_bodies(scenario, PEOPLE)
    table = run.table
    bodies, crowds, frames = (
        run.samples[topic.key] for topic in (TARGET_SKELETON, PEOPLE, SKELETONS)
    )
    t = np.array([body.header.stamp.ns / 1e9 for body in bodies])
    robot = Poses(*(column[table.ticks(t)] for column in table.poses("robot")))
    person = PersonOverTime(np.array([_joints(body.joints) for body in bodies]), bodies[0].height)
    return Watched(
        table,
        t,
        robot,
        person,
        _pedestrians(crowds, t),
        bodies,
        # frames taken before the start have no stamp
        [(f.header, _shown(f, table, t, person)) for f in frames if f.header.stamp.ns],
        run.trajectory_sha256,
    )


def _joints(points: Sequence[m.Point]) -> list[tuple[float, float, float]]:
    return [(point.x, point.y, point.z) for point in points]


def _pedestrians(crowds: Sequence[m.People], t: Floats) -> tuple[PersonOverTime, ...]:
    """Return all reported people except the robot's person."""
    pedestrians: dict[str, PersonOverTime] = {}
    for crowd in crowds:
        row = int(np.searchsorted(t, crowd.header.stamp.ns / 1e9 - 1e-6))
        for person in crowd.persons:
            if person.id == "target" or row >= len(t):
                continue
            absent = np.full((len(t), len(JOINTS), 3), np.nan)
            pedestrian = pedestrians.setdefault(person.id, PersonOverTime(absent, person.height))
            pedestrian.joints[row] = _joints(person.joints)
    return tuple(pedestrians.values())


def _shown(
    frame: m.Skeletons, table: Table, t: Floats, person: PersonOverTime
) -> m.Skeleton | None:
    """Return the body of a frame that is at the person's position at the capture."""
    time_s = frame.header.stamp.ns / 1e9
    row = min(int(np.searchsorted(t, time_s - 1e-6)), len(t) - 1)
    robot = table.poses("robot").at(int(table.ticks(np.array([time_s]))[0]))
    x, y, _ = person.joints[row, PELVIS]
    for body in frame.skeletons:
        if body.confidence and not body.confidence[PELVIS]:
            continue
        pelvis = body.joints[PELVIS]
        place = robot.compose(robot._replace(x=pelvis.x, y=pelvis.y, yaw=0.0))
        if np.hypot(place.x - x, place.y - y) < SAME_M:
            return body
    return None
