"""The metrics of Follow-Bench 1.0, as its code computes them.

Its code records a row after each step. So the start is not a row, and the first step adds no path
length. If a run ends early, the rest of the episode counts as out of sight and outside of every
zone.
"""

from __future__ import annotations

import math
from itertools import groupby

import numpy as np
import numpy.typing as npt
from mecazen.portable import Floats

from mecazen_experiments.followbench.episodes import STEP_S, Episode
from mecazen_experiments.followbench.play import Record
from mecazen_experiments.followbench.robot import HALF, PERSON_RADIUS

RADII_M = math.hypot(*HALF) + PERSON_RADIUS
"""Sum of the radius of the circle around the robot's outline and the radius of a person [m]."""
PRIVATE_M, PERSONAL_M = 0.45, 1.2
"""Outer radii of the private and the personal zone of a person [m], after E. T. Hall, 1966."""


def metrics(record: Record, episode: Episode) -> dict[str, bool | float]:
    """Return the metrics of an episode; shares in percent.

    `asr` is true without contact, `sr` if the target was also never out of sight for too long.
    `tvr` is the share of the longest possible episode with the target visible, `tin_tperson` in the
    target's personal zone outside of the private zone, and `tin_private` in the private zone of
    another person. `pl_m` is the length of the axle's path, `search_s` the time without the target.
    """
    robot, target, visible = record.robot[1:], record.target[1:], record.visible[1:]
    free = np.hypot(*(target - robot[:, :2]).T) - RADII_M
    distances = np.hypot(*np.moveaxis(record.humans[1:] - robot[:, None, :2], -1, 0))
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
        "pl_m": float(np.hypot(*np.diff(robot[:, :2], axis=0).T).sum()),
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
