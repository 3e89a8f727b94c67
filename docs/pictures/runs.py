"""Moments of a run: true poses of robots and people, and the newest messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
import numpy.typing as npt
from mecazen import Simulation
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.keys import (
    DEPTH,
    FOLLOWER_STATE,
    GUARD_STATE,
    JOINT_STATES,
    PEOPLE,
    SCAN,
    SKELETONS,
    TARGET_SKELETON,
)

from docs.pictures.planning import WAYS

Array = npt.NDArray[np.float64]

FOLLOWED = "target"
TOPICS = SCAN, FOLLOWER_STATE, GUARD_STATE, JOINT_STATES, DEPTH, WAYS
KEPT = tuple(topic.key for topic in TOPICS)
LATE_S = 0.3
"""Extra simulated time, more than the latency of the camera."""


@dataclass(frozen=True)
class Moment:
    """A tick of a run."""

    time_s: float
    robot: Pose2D
    """The robot's true pose in world."""
    people: dict[str, Array]
    """True joints (20, 3) in world [m] by name; the robot follows `FOLLOWED`."""
    latest: dict[str, Any]
    """The newest message of each topic."""
    bones: tuple[m.Skeleton, ...]
    """Bodies in the tracker's frame nearest to this time, in base_link."""
    bones_from: Pose2D
    """The robot's true pose when this frame was taken."""

    @property
    def follower(self) -> m.FollowerState:
        """The follower's state."""
        state = self.latest[FOLLOWER_STATE.key]
        assert isinstance(state, m.FollowerState)
        return state


def record(
    scenario: str | PathLike[str] | Scenario,
    times: Sequence[float],
    settings: Mapping[str, Any] = {},
) -> tuple[Scenario, list[Moment]]:
    """Simulate a scenario; return the scenario and its moments at some times [s]."""
    poses: dict[int, Pose2D] = {}
    frames: dict[int, m.Skeletons] = {}
    found = []
    with Simulation(scenario, settings) as sim:
        tick_s = sim.scenario.sim.tick_s
        wanted = {round(time / tick_s) for time in times}
        for _ in sim.ticks(max(times) + LATE_S):
            tick = round(sim.time_s / tick_s)
            poses[tick] = sim.state.robot
            seen = newest(sim, SKELETONS.key)
            if isinstance(seen, m.Skeletons):
                frames[round(seen.header.stamp.ns / 1e9 / tick_s)] = seen
            if tick in wanted:
                messages = {key: newest(sim, key) for key in KEPT}
                found.append((tick, _people(sim), messages))
        whole = sim.scenario
    moments = []
    for tick, people, latest in found:
        _, taken = min(((abs(at - tick), at) for at in frames), default=(0, tick))
        bones = frames[taken].skeletons if taken in frames else ()
        moments.append(
            Moment(
                tick * tick_s,
                poses[tick],
                people,
                latest,
                bones,
                poses.get(taken, poses[tick]),
            )
        )
    return whole, moments


def newest(sim: Simulation, key: str) -> m.Message | None:
    """Return the newest message on a key; None also if the scenario has no such key."""
    try:
        message: m.Message | None = sim.latest(key)
    except ConfigError:
        return None
    return message


def joints(points: Sequence[m.Point]) -> Array:
    """Return joints as an array (n, 3) [m]."""
    return np.array([(point.x, point.y, point.z) for point in points])


def _people(sim: Simulation) -> dict[str, Array]:
    people, followed = newest(sim, PEOPLE.key), newest(sim, TARGET_SKELETON.key)
    if isinstance(people, m.People):
        return {one.id: joints(one.joints) for one in people.persons if one.joints}
    return {FOLLOWED: joints(followed.joints)} if isinstance(followed, m.Skeleton) else {}
