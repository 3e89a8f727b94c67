"""The metrics of Follow-Bench 1.0, as its code computes them, and our additional metrics.

Its code records a row after each step. So the start is not a row, and the first step adds no path
length. If a run ends early, the rest of the episode counts as out of sight and outside of every
zone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec
import numpy as np
from mecazen.geometry import Pose2D
from mecazen.portable import Floats, arctan2
from mecazen_tools.table import wrap

from mecazen_experiments.followbench.play import Record
from mecazen_experiments.followbench.unicycle import HALF, PERSON_RADIUS, gaps
from mecazen_experiments.followbench.view import Place
from mecazen_experiments.gaps import drives_at
from mecazen_experiments.statistics import (
    Interval,
    paired_difference,
    paired_share_difference,
)

RADII_M = math.hypot(*HALF) + PERSON_RADIUS
"""Sum of the radius of the circle around the robot's outline and the radius of a person [m]."""
PRIVATE_M, PERSONAL_M = 0.45, 1.2
"""Outer radii of the private and the personal zone of a person [m], after E. T. Hall, 1966."""
MIN_SPEED_M_S = 0.01
"""Speed below which the target keeps its heading."""


SUCCESSES = "sr", "asr", "caused_contact"
"""Metrics that are 0 or 100 in an episode."""


class Metrics(msgspec.Struct, frozen=True):
    """The measures of an episode; shares in percent."""

    sr: float
    """100 for a success: no contact, and never out of sight for too long."""
    asr: float
    """100 without contact."""
    tvr: float
    """Share of the longest possible episode with the target visible."""
    tin_tperson: float
    """Share of this time in the target's personal zone, outside of the private zone."""
    tin_private: float
    """Share of this time in the private zone of another person."""
    pl_m: float
    """Length of the axle's path."""
    avg_vel_m_s: float
    avg_acc_m_s2: float
    jerk_m_s3: float
    search_path_m: float
    """Length of the path while the target is out of sight."""
    search_time_s: float
    caused_contact: float
    """100 for a contact that the robot caused, see `has_caused_contact`. This metric and the
    following ones are not part of Follow-Bench."""
    in_view: float
    """Share of the driven steps with the target visible."""
    d_err_m: float
    """Mean of |D - D0|; D is the distance from axle to target."""
    heading_err_deg: float | None
    """Mean error of the robot's heading; None beside a target that never moves.

    Behind the target the robot shall face the target; beside it, the robot shall face the direction
    of the target's motion.
    """


def measure(record: Record, place: Place, distance: float) -> Metrics:
    """Return the metrics of an episode in which the robot shall keep a place and distance [m]."""
    dt, most = record.step_s, record.max_steps
    robot, target, visible = record.robot[1:], record.target[1:], record.visible[1:]
    to_target = np.hypot(*(target - robot[:, :2]).T)
    free = to_target - RADII_M
    others = np.hypot(*np.moveaxis(record.humans[1:] - robot[:, None, :2], -1, 0))
    nearest = others.min(axis=1, initial=np.inf) - RADII_M
    path = np.hypot(*np.diff(robot[:, :2], axis=0).T)
    velocity = velocities(record)
    has_avoided = not record.collided
    has_kept = _longest((~visible).tolist()) <= record.max_search_steps
    heading_errors = _heading_errors(record, place)
    return Metrics(
        sr=100.0 * (has_avoided and has_kept),
        asr=100.0 * has_avoided,
        tvr=100.0 * int(np.count_nonzero(visible)) / most,
        tin_tperson=100.0 * int(np.count_nonzero((free > PRIVATE_M) & (free < PERSONAL_M))) / most,
        tin_private=100.0 * int(np.count_nonzero(nearest < PRIVATE_M)) / most,
        pl_m=float(path.sum()),
        avg_vel_m_s=_mean_norm(velocity),
        avg_acc_m_s2=_mean_norm(np.diff(velocity, axis=0, prepend=velocity[:1]) / dt),
        jerk_m_s3=_mean_norm(np.diff(velocity, n=2, axis=0, prepend=velocity[:2]) / dt**2),
        search_path_m=float(path[~visible[1:]].sum()),
        search_time_s=float(np.count_nonzero(~visible) * dt),
        caused_contact=100.0 * bool(has_caused_contact(record)),
        in_view=100.0 * float(visible.mean()),
        d_err_m=float(np.abs(to_target - distance).mean()),
        heading_err_deg=float(np.degrees(np.abs(heading_errors).mean()))
        if len(heading_errors)
        else None,
    )


def velocities(record: Record) -> Floats:
    """Return the velocity (n, 2) [m/s] of the axle in the world in each step.

    The code of Follow-Bench combines the speed of a step with the heading after the step; the robot
    moves along the heading before the step.
    """
    before, after = record.robot[:-1, 2], record.robot[1:, 2]
    dx, dy = np.diff(record.robot[:, :2], axis=0).T / record.step_s
    speed = np.cos(before) * dx + np.sin(before) * dy
    return np.stack((speed * np.cos(after), speed * np.sin(after)), axis=1)


def has_caused_contact(record: Record) -> bool:
    """Return whether the episode ended in a contact that the robot caused.

    A contact arises in the robot's move of the last step, or in a person's move of the previous
    step. The robot caused it if it drove at the person in that step, see `gaps.drives_at`. The
    robot always causes a contact with a box.
    """
    if not record.collided:
        return False
    last = len(record.robot) - 1
    now, before, earlier = (
        Pose2D(*record.robot[max(last - back, 0)].tolist()) for back in range(3)
    )
    people, were = (
        np.vstack((record.target[at], record.humans[at])) for at in (last - 1, max(last - 2, 0))
    )
    touched = gaps(now, people) <= 0.0
    if not touched.any():
        return True
    gap, gap_before = gaps(before, people), gaps(earlier, were)
    drove = np.where(
        gap > 0.0,
        drives_at(gap, gaps(now, people), record.step_s),
        drives_at(gap_before, gaps(before, were), record.step_s),
    )
    return bool(np.any(drove & touched))


def compare(a: Mapping[str, Metrics], b: Mapping[str, Metrics]) -> dict[str, Interval]:
    """Return mean and interval of b - a for each metric, over the episodes that both drove.

    Args:
        a: The metrics of a planner by the name of the episode.
        b: The metrics of another planner, likewise.
    """
    differences = {}
    for name in Metrics.__struct_fields__:
        columns = [
            {episode: getattr(run, name) for episode, run in runs.items()} for runs in (a, b)
        ]
        one, other = ({k: v for k, v in each.items() if v is not None} for each in columns)
        if one.keys() & other.keys():
            of = paired_share_difference if name in SUCCESSES else paired_difference
            differences[name] = of(one, other)
    return differences


def _mean_norm(vectors: Floats) -> float:
    """Return the mean length of vectors (n, 2), or 0 if n is 0: a run of one step has no jerk."""
    return float(np.hypot(*vectors.T).mean()) if len(vectors) else 0.0


def _longest(flags: Iterable[bool]) -> int:
    """Return the length of the longest run of true flags."""
    longest = now = 0
    for flag in flags:
        now = now + 1 if flag else 0
        longest = max(longest, now)
    return longest


def _heading_errors(record: Record, place: Place) -> Floats:
    """Return the error of the robot's heading in each step that defines one [rad]."""
    heading = record.robot[1:, 2]
    if place == "back":
        wanted = arctan2(*(record.target[1:] - record.robot[1:, :2]).T[::-1])
        return wrap(heading - wanted)
    moves = np.diff(record.target, axis=0)
    is_moving = np.hypot(*moves.T) >= MIN_SPEED_M_S * record.step_s
    last = np.maximum.accumulate(np.where(is_moving, np.arange(len(moves)), -1))
    wanted = arctan2(*moves[last].T[::-1])
    return wrap(heading - wanted)[last >= 0]
