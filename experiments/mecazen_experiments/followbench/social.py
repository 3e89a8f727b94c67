"""The social-force follower of Follow-Bench: the reference whose results are published.

A driving force towards the goal and exponential repulsions (Helbing & Molnár, Phys. Rev. E 51,
1995) change the velocity of a point at the axle; a unicycle then turns into this velocity. The
formulas and parameters are those of Follow-Bench's planner (Ye et al., arXiv 2509.10796), including
two peculiarities that affect its results. Clusters of the scan repel as obstacles although some are
people. The direction vectors from clusters are divided by the norm of all vectors together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen.geometry import Pose2D, wrap
from mecazen.portable import Floats, exp, inverse, product
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from mecazen_experiments.followbench.episodes import DISTANCE_M, STEP_S, Place
from mecazen_experiments.followbench.play import Seen, View
from mecazen_experiments.followbench.robot import ANGLES, RANGE

SPEED_M_S, GAIN = 3.0, 1.3
"""Desired and maximum speed (the robot's own limit is 2 m/s), gain of the driving force [1/s]."""
ARRIVED_M, STILL_M = 0.7, 0.05
"""Distance to the goal below which the desired speed is 0, and below which the robot stops if the
goal has not moved farther."""
PEOPLE, THINGS, SAFE_M = (7.0, 0.5), (10.0, 0.5), 0.3
"""Strength [m/s²] and reach [m] of the repulsion by people and by clusters of the scan, and the
distance at which they repel with this strength."""
THINGS_M, TARGET_M = 5.0, 0.5
"""Distances beyond which clusters do not repel, and within which they are part of the target."""
TURN_RAD_S, TURN_S, ALIGNED_RAD, SLOW_M_S = 2.0, 0.2, 0.1, 0.02
"""Maximum yaw rate, time of a turn, angle below which no turn is needed, speed that counts as 0."""
AHEAD_S, SEARCH_M = 2.0, 0.2
"""Horizon of the prediction, and distance from it at which a search ends."""
INITIAL, PROCESS, MEASURED = 0.1**2, 0.05**2, 0.5**2
"""Variances of position [m²] and velocity [m²/s²]: initial, per step, per measurement."""
STANDING_M_S = 0.01
"""Below this speed, a person keeps the previous heading."""
NOTHING_M = 0.01
"""A beam that ends less than this before the maximum range hit nothing."""
REACH_M, LEAST = 0.5, 3
"""DBSCAN: the distance of neighbours, and the minimum number of neighbours of a core point,
including itself."""


class Social:
    """A follower driven by social forces."""

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode; nothing is drawn at random."""
        self._last: Seen | None = None
        self._heading = 0.0
        self._filter: ConstantVelocity | None = None
        self._goal: tuple[float, float] | None = None

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""
        goal, robot = self._chase(view), view.robot
        x, y = goal.x - robot.x, goal.y - robot.y
        distance = math.hypot(x, y)
        vx, vy = view.v * math.cos(robot.yaw), view.v * math.sin(robot.yaw)
        drive = SPEED_M_S / distance if distance > ARRIVED_M else 0.0
        push_x, push_y = self._push(view)
        vx += STEP_S * (GAIN * (drive * x - vx) + push_x)
        vy += STEP_S * (GAIN * (drive * y - vy) + push_y)
        scale = min(1.0, SPEED_M_S / max(math.hypot(vx, vy), 1e-9))
        last, self._goal = self._goal, (goal.x, goal.y)
        if last is not None and max(math.dist(last, self._goal), distance) < STILL_M:
            return 0.0, 0.0
        return unicycle(robot.yaw, scale * vx, scale * vy)

    def _chase(self, view: View) -> Pose2D:
        """Return the goal pose; it is the robot's pose until the target is first visible.

        As in Follow-Bench, the filter is updated only during a search, with the last sight as
        measurement, and keeps its state from one search to the next.
        """
        robot, target = view.robot, view.target
        if target is not None:
            if math.hypot(target.vx, target.vy) >= STANDING_M_S:
                self._heading = math.atan2(target.vy, target.vx)
            self._last = target
            return place(target, self._heading, robot, view.place, DISTANCE_M)
        if self._last is None:
            return robot
        if self._filter is None:
            self._filter = ConstantVelocity(self._last)
        ahead = self._filter.step(self._last)
        return place(ahead, self._heading, robot, "back", SEARCH_M)

    def _push(self, view: View) -> tuple[float, float]:
        """Return the repulsion [m/s²] from visible people and from clusters of the scan."""
        middles = [center(group) for group in clusters(points(view))]
        last = self._last
        if last is not None:
            middles = [middle for middle in middles if math.dist(middle, last[:2]) > TARGET_M]
        away, ranges = _away(view.robot, [person[:2] for person in view.people])
        x, y = _repulsion(away / ranges[:, None], ranges, *PEOPLE)
        away, ranges = _away(view.robot, middles)
        away, ranges = away[ranges < THINGS_M], ranges[ranges < THINGS_M]
        norm = math.sqrt(math.fsum((ranges * ranges).tolist()))
        things_x, things_y = _repulsion(away / max(norm, 1e-9), ranges, *THINGS)
        return x + things_x, y + things_y


def _away(robot: Pose2D, places: Sequence[tuple[float, float]]) -> tuple[Floats, Floats]:
    """Return the vectors from places to the robot (n, 2), and their lengths (n) [m]."""
    away = np.array(robot[:2]) - np.array(places).reshape(-1, 2)
    return away, np.hypot(away[:, 0], away[:, 1])


def _repulsion(away: Floats, ranges: Floats, strength: float, reach: float) -> tuple[float, float]:
    forces = strength * exp((SAFE_M - ranges) / reach)[:, None] * away
    return math.fsum(forces[:, 0].tolist()), math.fsum(forces[:, 1].tolist())


def unicycle(yaw: float, vx: float, vy: float) -> tuple[float, float]:
    """Return speed and yaw rate that turn a unicycle into a velocity, without backing up."""
    speed = math.hypot(vx, vy)
    if speed <= SLOW_M_S:
        return 0.0, 0.0
    off = wrap(math.atan2(vy, vx) - yaw)
    turn = 0.0 if abs(off) < ALIGNED_RAD else max(-TURN_RAD_S, min(TURN_RAD_S, off / TURN_S))
    return max(speed * math.cos(off), 0.0), turn


def place(target: Seen, heading: float, robot: Pose2D, where: Place, distance: float) -> Pose2D:
    """Return the goal pose of the robot for a target that walks in the direction `heading` [rad].

    For "back", the goal is on the line from the target to the robot, at any bearing. For
    "left_side", it is on the nearer side.
    """
    if where == "back":
        bearing = math.atan2(target.y - robot.y, target.x - robot.x)
        c, s = math.cos(bearing), math.sin(bearing)
        return Pose2D(target.x - distance * c, target.y - distance * s, bearing)
    x, y = -distance * math.sin(heading), distance * math.cos(heading)
    sides = Pose2D(target.x + x, target.y + y, heading), Pose2D(target.x - x, target.y - y, heading)
    return min(sides, key=robot.distance)


class ConstantVelocity:
    """Kalman filter of a position and velocity that are both measured.

    The axes share one covariance (2, 2), since all their variances are equal.
    """

    def __init__(self, first: Seen) -> None:
        self._state = np.array(first).reshape(2, 2)
        self._covariance = INITIAL * np.eye(2)

    def step(self, measured: Seen) -> Seen:
        """Predict one step, and correct by a measurement; return the state `AHEAD_S` later."""
        transition = np.array(((1.0, STEP_S), (0.0, 1.0)))
        prior = product(product(transition, self._covariance), transition.T) + PROCESS * np.eye(2)
        gain = product(prior, inverse(prior + MEASURED * np.eye(2)))
        state = product(transition, self._state)
        self._state = state + product(gain, np.array(measured).reshape(2, 2) - state)
        self._covariance = MEASURED * gain  # (I - K) P = K R
        (x, y), (vx, vy) = self._state.tolist()
        return Seen(x + AHEAD_S * vx, y + AHEAD_S * vy, vx, vy)


def points(view: View) -> Floats:
    """Return the points that beams hit, in the world (n, 2) [m]."""
    hit = view.ranges < RANGE - NOTHING_M
    angles, ranges = ANGLES[hit] + view.robot.yaw, view.ranges[hit]
    x, y = view.robot.x + ranges * np.cos(angles), view.robot.y + ranges * np.sin(angles)
    return np.stack((x, y), axis=1)


def clusters(places: Floats) -> list[Floats]:
    """Return the groups of points (n, 2): DBSCAN, Ester et al., KDD 1996; noise is left out."""
    dx = places[:, :1] - places[:, 0]
    dy = places[:, 1:] - places[:, 1]
    near = dx * dx + dy * dy <= REACH_M**2
    core = near.sum(axis=1) >= LEAST
    # a point at the border belongs to the first group that reaches it
    count, labels = connected_components(near[np.ix_(core, core)], directed=False)
    groups, free = [], np.ones(len(places), dtype=bool)
    for label in range(count):
        members = near[:, np.flatnonzero(core)[labels == label]].any(axis=1) & free
        free &= ~members
        groups.append(places[members])
    return groups


def center(places: Floats) -> tuple[float, float]:
    """Return the center of the smallest rectangle around points (n, 2).

    The rectangle shares a side with the convex hull of the points (Freeman & Shapira, 1975).
    """
    try:
        hull = places[ConvexHull(places).vertices]
    except QhullError:  # the points are on a line
        x, y = ((places.min(axis=0) + places.max(axis=0)) / 2.0).tolist()
        return x, y
    sides = np.roll(hull, -1, axis=0) - hull
    c, s = (sides / np.hypot(*sides.T)[:, None]).T[:, :, None]
    along, across = c * hull[:, 0] + s * hull[:, 1], c * hull[:, 1] - s * hull[:, 0]
    best = int((np.ptp(along, axis=1) * np.ptp(across, axis=1)).argmin())
    u, v = ((values[best].max() + values[best].min()) / 2.0 for values in (along, across))
    (cos,), (sin,) = c[best], s[best]
    return float(cos * u - sin * v), float(sin * u + cos * v)
