"""The program `safety`: contacts, gaps, sight and following among obstacles and people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.arrays import to_rectangle
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.robot import Robot
from mecazen.skeleton import INDEX, LIMBS
from mecazen_follower.tracker import TrackingState
from mecazen_tools.observe import PELVIS, PersonOverTime, Watched, watch
from mecazen_tools.table import Bools, Floats, Poses, Table, first_motion
from mecazen_tools.trajectory import LOST

from mecazen_experiments.scores import score

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

CAUSED_M_S = 0.05
"""Speed of the robot towards a person above which a contact that begins is caused by the robot."""
TTC_S = 1.0
"""A shorter time to collision is a conflict (J. C. Hayward, Near miss determination through use of
a scale of danger, 1972; the threshold is usual for people on foot)."""
STILL_M_S = 0.03
"""Speed below which a robot counts as standing."""
AWAY_M = 0.5
"""Distance from its goal beyond which a standing robot is frozen, while its person walks."""
_BEGINS = [INDEX[limb.begin] for limb in LIMBS]
_ENDS = [INDEX[limb.end] for limb in LIMBS]
_RADII = np.array([limb.radius for limb in LIMBS])

FOUND_M = 0.5
"""Greatest error of an estimate of the person who is found again, and no other."""


def safety(job: Job) -> dict[str, float | str | None]:
    """Simulate a job; return the measures of the run, and the hash of its trajectory."""
    scenario = job.load()
    run = watch(scenario)
    return measure(run, scenario) | {"trajectory": run.trajectory_sha256[:16]}


def measure(run: Watched, scenario: Scenario) -> dict[str, float | str | None]:
    """Return the measures of a run; None if there is nothing to measure.

    `contacts_person`, `contacts_others` and `contacts_walls` are the contacts that the robot
    caused, see `Contacts`, and `…_all` those with people, whoever caused them. `gap_…_m` are
    the smallest gaps, negative for overlap. `conflict_s` is the time with a time to collision with
    any person below 1 s, `view_percent` the share of the camera's frames that show the person,
    `regain_s` the longest time without such a frame, and `frozen_s` the time in which the robot
    stands 0.5 m or more from its goal while the person walks. D_err, Θ_err and jerk are those of
    `scores.score`. `lost` is 1 if the person was lost, `lost_s` the time of it, and `found_s`
    the time from the last sight before the first loss until the person, and no other, is followed.
    """
    robot, step_s = scenario.robot, float(np.mean(np.diff(run.t)))
    person, *pedestrians = (
        contacts(robot, run.robot, body, step_s) for body in (run.person, *run.pedestrians)
    )
    walls = gap_to_walls(scenario, run.robot)
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
        **_refound(run.table),
        "jerk_rms_m_s3": following["jerk_rms_m_s3"],
        "time_s": float(run.table["t_s"][-1]),
    }


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


def _refound(table: Table) -> dict[str, float | None]:
    """Return whether the person was lost, and the time from the last sight to the next."""
    states, t = table.tracking, table["t_s"]
    lost = np.flatnonzero(np.isin(states, LOST))
    if not lost.size:
        return {"lost": 0.0, "found_s": None, "lost_s": 0.0}
    seen = states == TrackingState.FOLLOWING
    robot, odom, person = (table.poses(name) for name in ("robot", "odom", "target"))
    truth, estimate = odom.compose(robot.between(person)), table.poses("estimate")
    right = seen & (np.hypot(truth.x - estimate.x, truth.y - estimate.y) < FOUND_M)
    last = np.flatnonzero(seen[: lost[0]])[-1]
    again = np.flatnonzero(right[lost[0] :])
    found = float(t[lost[0] + again[0]] - t[last]) if again.size else None
    return {"lost": 1.0, "found_s": found, "lost_s": len(lost) * table.tick_s}


def _least(gaps: Floats) -> float | None:
    known = gaps[np.isfinite(gaps)]
    return float(known.min()) if known.size else None


class Contacts(NamedTuple):
    """The contacts of a robot with a person."""

    gap_m: Floats
    """Distance from the robot to the person (n) [m]; 0 or negative in contact."""
    rows: npt.NDArray[np.int64]
    """The sample before each contact (k)."""
    caused: Bools
    """Whether the robot caused each contact (k): it moved towards the place where the person was,
    at more than `CAUSED_M_S`."""


def contacts(robot: Robot, poses: Poses, person: PersonOverTime, step_s: float) -> Contacts:
    """Return the contacts of a robot at n poses with a person at the same times."""
    gap = gap_to_person(robot, poses, person)
    rows = onsets(gap)
    after = np.minimum(rows + 1, len(gap) - 1)
    before = PersonOverTime(person.joints[rows], person.height)
    moved = gap_to_person(robot, Poses(*(column[after] for column in poses)), before)
    with np.errstate(invalid="ignore"):
        return Contacts(gap, rows, (gap[rows] - moved) / step_s > CAUSED_M_S)


def onsets(gap: Floats) -> npt.NDArray[np.int64]:
    """Return the begins of contacts: the sample before the first sample of each contact."""
    touching = gap <= 0.0
    begins = np.flatnonzero(touching & ~np.concatenate(([False], touching[:-1])))
    return np.maximum(begins - 1, 0)


def gap_to_person(robot: Robot, poses: Poses, person: PersonOverTime) -> Floats:
    """Return the distance from a robot's footprint to a person's limbs (n) [m].

    The distance is that of a rectangle and capsules seen from above; only the parts of limbs below
    the robot's top count. If they overlap, the distance is negative, down to minus the radius of a
    limb. It is NaN while there is no person.
    """
    begins, ends = person.joints[:, _BEGINS], person.joints[:, _ENDS]
    radii, along = _RADII * person.height, ends - begins
    top = robot.height + radii
    # from share `low` to share `high` of its length, a limb is not above the robot
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        cut = np.clip((top - begins[..., 2]) / along[..., 2], 0.0, 1.0)
    low = np.where(along[..., 2] < 0.0, cut, 0.0)[..., None]
    high = np.where(along[..., 2] > 0.0, cut, 1.0)[..., None]
    first, last = (_seen(poses, (begins + share * along)[..., :2]) for share in (low, high))
    gaps = _to_segments(robot.footprint, first, last) - radii
    gaps[np.minimum(begins[..., 2], ends[..., 2]) > top] = math.inf
    nearest: Floats = gaps.min(axis=1)
    return nearest


def gap_to_walls(scenario: Scenario, poses: Poses) -> Floats:
    """Return the distance from the robot to the nearest obstacle that is not above it (n) [m]."""
    gaps = [
        gap_to_obstacle(scenario.robot, poses, solid)
        for solid in scenario.world.solids
        if not (isinstance(solid, Box) and solid.bottom_m >= scenario.robot.height)
    ]
    nearest: Floats = np.min([np.full(len(poses.x), math.inf), *gaps], axis=0)
    return nearest


def gap_to_obstacle(robot: Robot, poses: Poses, solid: Box | Cylinder) -> Floats:
    """Return the distance from a robot's footprint to an obstacle (n) [m]; 0 if they touch.

    For a cylinder the distance is negative if they overlap.
    """
    n, half = len(poses.x), robot.footprint
    if isinstance(solid, Cylinder):
        centre = np.broadcast_to(solid.position_m, (n, 1, 2))
        return _to_outline(poses, half, centre)[:, 0] - solid.size_m[0]
    box = Poses(*np.full((n, 3), (*solid.position_m, math.radians(solid.yaw_deg))).T)
    half_box = solid.size_m[0] / 2.0, solid.size_m[1] / 2.0
    # the shortest line between two rectangles starts at a corner of one of them
    to_robot = _to_outline(poses, half, _corners(box, half_box))
    to_box = _to_outline(box, half_box, _corners(poses, half))
    nearest: Floats = np.minimum(to_robot.min(axis=1), to_box.min(axis=1))
    return nearest


def _to_outline(poses: Poses, half: tuple[float, float], points: Floats) -> Floats:
    """Return the distances of points (n, k, 2) from a rectangle at poses (n): 0 within it."""
    x, y = np.moveaxis(_seen(poses, points), -1, 0)
    return np.maximum(to_rectangle(x, y, half), 0.0)


def _seen(poses: Poses, points: Floats) -> Floats:
    """Transform points (n, k, 2) to the frames of poses (n)."""
    c, s = np.cos(poses.yaw)[:, None], np.sin(poses.yaw)[:, None]
    dx, dy = points[..., 0] - poses.x[:, None], points[..., 1] - poses.y[:, None]
    return np.stack((c * dx + s * dy, c * dy - s * dx), axis=-1)


def _corners(poses: Poses, half: tuple[float, float]) -> Floats:
    """Return the corners (n, 4, 2) of rectangles at poses (n)."""
    corners = [poses.compose(Pose2D(x, y))[:2] for x, y in _signed(half)]
    return np.moveaxis(np.array(corners), 2, 0)


def _signed(half: tuple[float, float]) -> list[tuple[float, float]]:
    return [(x, y) for x in (half[0], -half[0]) for y in (half[1], -half[1])]


def _to_segments(half: tuple[float, float], first: Floats, last: Floats) -> Floats:
    """Return the distances of segments (n, k, 2) from a rectangle at the origin: 0 within it.

    The nearest point of a segment is an end of it, or the foot of the perpendicular from a corner,
    or it is where the line crosses a side of the rectangle.
    """
    along = last - first
    corners = np.array(_signed(half))
    with np.errstate(divide="ignore", invalid="ignore"):
        feet = np.sum((corners - first[..., None, :]) * along[..., None, :], axis=-1)
        feet /= np.sum(along**2, axis=-1)[..., None]
        sides = np.stack((np.array(half), -np.array(half)))
        crossings = (sides - first[..., None, :]) / along[..., None, :]
    ends = np.broadcast_to((0.0, 1.0), (*first.shape[:-1], 2))
    crossings = crossings.reshape(*first.shape[:-1], 4)
    shares = np.nan_to_num(np.concatenate((ends, feet, crossings), axis=-1), posinf=1.0, neginf=0.0)
    points = first[..., None, :] + np.clip(shares, 0.0, 1.0)[..., None] * along[..., None, :]
    nearest: Floats = np.maximum(to_rectangle(points[..., 0], points[..., 1], half), 0.0).min(-1)
    return nearest
