"""Scores of a run among obstacles and people: contacts, gaps, visibility, and following."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from mecazen.config import Scenario, WorldConfig
from mecazen.config.world import Box
from mecazen.geometry import Pose2D, Standoff
from mecazen.robot import Robot
from mecazen_tools.observe import PELVIS, PersonOverTime, Watched
from mecazen_tools.table import Bools, Floats, first_motion

from mecazen_experiments.gaps import (
    drives_at,
    gap_to_obstacle,
    gap_to_person,
    height_of,
    onsets,
)
from mecazen_experiments.scores import score

TTC_S = 1.0
"""A shorter time to collision is a conflict (J. C. Hayward, Near miss determination through use of
a scale of danger, 1972; the threshold is usual for people on foot)."""
STILL_M_S = 0.03
"""Speed below which a robot counts as standing."""
AWAY_M = 0.5
"""Distance from its goal beyond which a standing robot is frozen, while its person walks."""


class Safety(msgspec.Struct, frozen=True):
    """The measures of a run; None if there is nothing to measure."""

    contacts_person: int
    """Number of contacts with the person that begin while the robot drives at the person."""
    contacts_person_all: int
    """Number of all contacts with the person, caused by the robot or not."""
    contacts_others: int
    """The same two numbers for other people."""
    contacts_others_all: int
    contacts_world: int
    """Number of contacts with walls and other obstacles."""
    gap_person_m: float | None
    """Smallest gap to the person, likewise to others and to obstacles in the next two; negative for
    overlap."""
    gap_others_m: float | None
    gap_world_m: float | None
    conflict_s: float
    """Time in which the time to collision with any person is below 1 s."""
    view_percent: float
    """Share of the camera's frames that show the person."""
    regain_s: float
    """Longest time without a frame that shows the person."""
    d_err_m: float | None
    """As in `Score`, like the next one."""
    theta_err_deg: float | None
    frozen_s: float
    """Time in which the robot stands 0.5 m or more from its goal while the person walks."""
    jerk_rms_m_s3: float | None
    time_s: float
    """Duration of the run."""


def safety(seen: Watched, scenario: Scenario) -> Safety:
    """Return the measures of a run."""
    robot, world = scenario.robot, scenario.world
    step = float(np.mean(np.diff(seen.t)))
    to_person = gap_to_person(robot, seen.robot, *seen.person)
    to_others = [gap_to_person(robot, seen.robot, *body) for body in seen.pedestrians]
    to_world = _world(robot, seen, world)
    standoff = scenario.follower.standoff
    begin = first_motion(seen.table) or 0
    begins_s = float(seen.table["t_s"][begin])
    times, shown = seen.sight
    times, shown = times[times >= begins_s], shown[times >= begins_s]
    following = score(seen.table, standoff).whole
    return Safety(
        contacts_person=_caused(robot, seen, seen.person, to_person),
        contacts_person_all=len(onsets(to_person)),
        contacts_others=sum(
            _caused(robot, seen, body, gap)
            for body, gap in zip(seen.pedestrians, to_others, strict=True)
        ),
        contacts_others_all=sum(len(onsets(gap)) for gap in to_others),
        contacts_world=len(onsets(to_world)),
        gap_person_m=_least(to_person),
        gap_others_m=_least(np.array(to_others)),
        gap_world_m=_least(to_world),
        conflict_s=float(np.sum(_in_conflict(seen, [to_person, *to_others], step))) * step,
        view_percent=100.0 * float(np.mean(shown)) if len(shown) else 0.0,
        regain_s=_longest_gap(times, shown),
        d_err_m=following.d_err_m,
        theta_err_deg=following.theta_err_deg,
        frozen_s=_frozen(seen, standoff, begin),
        jerk_rms_m_s3=following.jerk_rms_m_s3,
        time_s=float(seen.table["t_s"][-1]),
    )


def _world(robot: Robot, seen: Watched, world: WorldConfig) -> Floats:
    height = height_of(robot)
    gaps = [
        gap_to_obstacle(robot, seen.robot, thing)
        for thing in world.solids
        if not (isinstance(thing, Box) and thing.bottom_m >= height)
    ]
    return np.min(gaps, axis=0) if gaps else np.full(len(seen.t), math.inf)


def _caused(robot: Robot, seen: Watched, body: PersonOverTime, gap: Floats) -> int:
    """Return the number of contacts with a person that begin while the robot drives at the person.

    The robot drives at the person if its move to its pose one sample later closes the gap, see
    `gaps.drives_at`.
    """
    begins = onsets(gap)
    if not len(begins):
        return 0
    later = seen.robot._replace(
        **{name: np.append(column[1:], column[-1]) for name, column in seen.robot._asdict().items()}
    )
    step = float(np.mean(np.diff(seen.t)))
    return int(np.sum(drives_at(gap, gap_to_person(robot, later, *body), step)[begins]))


def _in_conflict(seen: Watched, gaps: Sequence[Floats], step: float) -> Bools:
    """Return the samples in which the time to collision with any person is below `TTC_S` (n).

    The speed is that between pelvis and robot: a swinging foot does not count as an approach.
    """
    found = np.zeros(len(seen.t), dtype=bool)
    for body, gap in zip((seen.person, *seen.pedestrians), gaps, strict=True):
        x, y = body.joints[:, PELVIS, 0] - seen.robot.x, body.joints[:, PELVIS, 1] - seen.robot.y
        closing = -np.gradient(np.hypot(x, y), step)
        with np.errstate(invalid="ignore"):
            found |= (closing > 0.0) & (np.maximum(gap, 0.0) < TTC_S * closing)
    return found


def _longest_gap(looked: Floats, shown: Bools) -> float:
    """Return the longest time between two frames that show the person, less the usual period."""
    if len(looked) < 2:
        return 0.0
    usual = float(np.median(np.diff(looked)))
    at = np.concatenate(([looked[0] - usual], looked[shown], [looked[-1] + usual]))
    return max(0.0, float(np.max(np.diff(at))) - usual)


def _frozen(seen: Watched, standoff: Standoff, begin: int) -> float:
    table = seen.table.where(slice(begin, None))
    robot, person = table.poses("robot"), table.poses("target")
    place = person.compose(standoff.goal(Pose2D()))
    away = np.hypot(robot.x - place.x, robot.y - place.y) > AWAY_M
    still = np.hypot(table["robot_vx_m_s"], table["robot_vy_m_s"]) < STILL_M_S
    walks = np.hypot(table["target_vx_m_s"], table["target_vy_m_s"]) > STILL_M_S
    return float(np.sum(away & still & walks)) * table.tick_s


def _least(gaps: Floats) -> float | None:
    known = gaps[np.isfinite(gaps)]
    return float(known.min()) if known.size else None
