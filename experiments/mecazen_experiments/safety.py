"""The program `safety`: contacts, gaps, sight and following among obstacles and people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from mecazen.config import Scenario
from mecazen.config.world import Box
from mecazen.geometry import Pose2D
from mecazen_tools.observe import PELVIS, Watched, watch
from mecazen_tools.table import Bools, Floats, first_motion

from mecazen_experiments.gaps import contacts, gap_to_obstacle, onsets
from mecazen_experiments.scores import score

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

TTC_S = 1.0
"""A shorter time to collision is a conflict (J. C. Hayward, Near miss determination through use of
a scale of danger, 1972; the threshold is usual for people on foot)."""
STILL_M_S = 0.03
"""Speed below which a robot counts as standing."""
AWAY_M = 0.5
"""Distance from its goal beyond which a standing robot is frozen, while its person walks."""


def safety(job: Job) -> dict[str, float | str | None]:
    """Simulate a job; return the measures of the run, and the hash of its trajectory."""
    scenario = job.load()
    run = watch(scenario)
    return measure(run, scenario) | {"trajectory": run.trajectory_sha256[:16]}


def measure(run: Watched, scenario: Scenario) -> dict[str, float | str | None]:
    """Return the measures of a run; None if there is nothing to measure.

    `contacts_person`, `contacts_others` and `contacts_walls` are the contacts that the robot
    caused, see `gaps.contacts`, and `…_all` those with people, whoever caused them. `gap_…_m` are
    the smallest gaps, negative for overlap. `conflict_s` is the time with a time to collision with
    any person below 1 s, `view_percent` the share of the camera's frames that show the person,
    `regain_s` the longest time without such a frame, and `frozen_s` the time in which the robot
    stands 0.5 m or more from its goal while the person walks. D_err, Θ_err and jerk are those of
    `scores.score`.
    """
    robot, step_s = scenario.robot, float(np.mean(np.diff(run.t)))
    person, *pedestrians = (
        contacts(robot, run.robot, body, step_s) for body in (run.person, *run.pedestrians)
    )
    walls = _walls(run, scenario)
    begin = first_motion(run.table) or 0
    times, shown = run.sight
    moving = times >= run.table["t_s"][begin]
    following = score(run.table, scenario.follower.standoff)
    gaps = [person.gap_m, *(pedestrian.gap_m for pedestrian in pedestrians)]
    return {
        "contacts_person": int(person.caused.sum()),
        "contacts_person_all": len(person.rows),
        "contacts_others": sum(int(pedestrian.caused.sum()) for pedestrian in pedestrians),
        "contacts_others_all": sum(len(pedestrian.rows) for pedestrian in pedestrians),
        "contacts_walls": len(onsets(walls)),
        "gap_person_m": _least(person.gap_m),
        "gap_others_m": _least(np.array(gaps[1:])),
        "gap_walls_m": _least(walls),
        "conflict_s": float(np.sum(_in_conflict(run, gaps, step_s))) * step_s,
        "view_percent": 100.0 * float(np.mean(shown[moving])) if moving.any() else 0.0,
        "regain_s": _longest_gap(times[moving], shown[moving]),
        "d_err_m": following["d_err_m"],
        "theta_err_deg": following["theta_err_deg"],
        "frozen_s": _frozen(run, scenario, begin),
        "jerk_rms_m_s3": following["jerk_rms_m_s3"],
        "time_s": float(run.table["t_s"][-1]),
    }


def _walls(run: Watched, scenario: Scenario) -> Floats:
    """Return the gaps to the nearest obstacle that is not above the robot (n) [m]."""
    robot = scenario.robot
    gaps = [
        gap_to_obstacle(robot, run.robot, solid)
        for solid in scenario.world.solids
        if not (isinstance(solid, Box) and solid.bottom_m >= robot.height)
    ]
    return np.min(gaps, axis=0) if gaps else np.full(len(run.t), math.inf)


def _in_conflict(run: Watched, gaps: Sequence[Floats], step_s: float) -> Bools:
    """Return the samples in which the time to collision with any person is below `TTC_S` (n).

    The speed is that between pelvis and robot: a swinging foot does not count as an approach.
    """
    conflict = np.zeros(len(run.t), dtype=bool)
    for body, gap in zip((run.person, *run.pedestrians), gaps, strict=True):
        x, y = body.joints[:, PELVIS, 0] - run.robot.x, body.joints[:, PELVIS, 1] - run.robot.y
        closing = -np.gradient(np.hypot(x, y), step_s)
        with np.errstate(invalid="ignore"):
            conflict |= (closing > 0.0) & (np.maximum(gap, 0.0) < TTC_S * closing)
    return conflict


def _longest_gap(times: Floats, shown: Bools) -> float:
    """Return the longest time between two frames that show the person, less the usual period."""
    if len(times) < 2:
        return 0.0
    usual = float(np.median(np.diff(times)))
    seen = np.concatenate(([times[0] - usual], times[shown], [times[-1] + usual]))
    return max(0.0, float(np.max(np.diff(seen))) - usual)


def _frozen(run: Watched, scenario: Scenario, begin: int) -> float:
    table = run.table.where(slice(begin, None))
    robot, person = table.poses("robot"), table.poses("target")
    goal = person.compose(scenario.follower.standoff.goal(Pose2D()))
    is_away = np.hypot(robot.x - goal.x, robot.y - goal.y) > AWAY_M
    stands = np.hypot(table["robot_vx_m_s"], table["robot_vy_m_s"]) < STILL_M_S
    walks = np.hypot(table["target_vx_m_s"], table["target_vy_m_s"]) > STILL_M_S
    return float(np.sum(is_away & stands & walks)) * table.tick_s


def _least(gaps: Floats) -> float | None:
    known = gaps[np.isfinite(gaps)]
    return float(known.min()) if known.size else None
