"""The search for a lost person: a map of the scans since the loss, and where to look next.

The lidar sees all that moves around the robot, and so the person is behind an edge of what it sees:
an opening (B. Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997). Or the
person is a thing as narrow as legs that the camera has not looked at yet. The robot drives to the
place with the least sum of its own way and the distance from where the person is expected.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.arrays import compose
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import LaserScan
from mecazen.portable import Floats
from mecazen.scan import STRIDE_M, clusters, ranges_of

from mecazen_follower.estimators import Estimate
from mecazen_follower.sight import FieldOfView

CELL_M, CELLS = 0.1, 160
"""Side of a cell, and number of cells along each side of the map about the place of the loss."""
HITS = 20
"""Scans through a cell until it is free after a hit: a beam along a wall passes its cells."""
REACH_M = 8.0
"""Range up to which a beam counts [m]."""
AHEAD_M, WALKS_M_S = 1.5, 0.2
"""Distance that a lost person is assumed to walk straight on [m], if faster than this speed."""
PASS_M, TURN_M = 0.04, 0.15
"""Gaps to obstacles that the robot needs to drive past them, and to turn beside them [m]."""
FREE_STANDING_M = 0.4
"""Minimum distance of a person's legs from all else that is seen [m]."""
BESIDE_BEAMS = 4
"""Number of beams from an edge to what is beside it."""
APART_M = 0.5
"""Things that are nearer to another person are that person [m]."""
MISSES = 20
"""Number of scans for which the robot still drives to a place that is no candidate any more."""
HESITATES, TRIES = 15, 45
"""Numbers of scans after which a robot that comes no nearer to a place drives on without a turn,
and after which it gives the place up."""
LOYALTY_M = 5.0
"""Another place must be nearer by this distance to replace the last."""
LOOK = 0.8
"""Share of the camera's range in which it recognises a person."""

Cells = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]


class Look(NamedTuple):
    """Where to drive and where to look, both in odom, and why."""

    way: tuple[float, float]
    """The next point on the way [m]."""
    place: tuple[float, float]
    """The point to look at [m]: the place, or the way until the place is in sight."""
    reason: str


class Search:
    """A search that begins when the person is lost.

    Args:
        person: The person when last seen.
        view: The camera's field of view and range.
        footprint: Half the robot's length and width [m].
    """

    def __init__(self, person: Estimate, view: FieldOfView, footprint: tuple[float, float]) -> None:
        x, y, _ = person.pose
        vx, vy, _ = person.velocity
        speed = math.hypot(vx, vy)
        ahead = AHEAD_M / speed if speed > WALKS_M_S else 0.0
        self._expected = x + ahead * vx, y + ahead * vy
        self._view = view
        self._far = LOOK * view.max_range
        self._origin = np.array((x, y)) - CELL_M * CELLS / 2
        self._passed: Cells = np.zeros((CELLS, CELLS), bool)
        self._hits = np.zeros((CELLS, CELLS), np.int8)
        """Scans that must pass through each cell until it is free."""
        self._looked: Cells = np.zeros((CELLS, CELLS), bool)
        self._things: Floats = np.empty((0, 2))
        corner = math.hypot(*footprint)
        self._tight, self._wide = (_disc((corner + gap) / CELL_M) for gap in (PASS_M, TURN_M))
        self._tried: Cells = np.zeros((CELLS, CELLS), bool)
        self._last: Floats | None = None
        """The place that was chosen last."""
        self._misses = 0
        """Number of looks for which that place has been no candidate."""
        self._halt, self._looks = np.zeros(2), 0
        """Where the robot has been since a number of looks at the same place."""

    def see(self, scan: LaserScan, lidar: Pose2D, robot: Pose2D) -> None:
        """Update the map with a scan, captured with lidar and robot at poses in odom."""
        ranges = ranges_of(scan)
        angles = lidar.yaw + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        rays = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        reach = np.nan_to_num(np.minimum(ranges, REACH_M + CELL_M), nan=0.0)
        steps = CELL_M * np.arange(0.5, REACH_M / CELL_M)
        beams, along = np.nonzero(steps < reach[:, None] - CELL_M)
        free = self._cells(rays[beams] * steps[along, None] + lidar[:2])
        hits = np.flatnonzero((reach > 0.0) & (reach <= REACH_M))
        solid = self._cells(rays[hits] * (ranges[hits, None] + CELL_M / 4) + lidar[:2])
        # new obstacles have come: the camera has to look at them again
        near = dilated(self._hits > 0, _disc(2.5))
        came = solid[~near.flat[solid]]
        passed = np.zeros_like(self._passed)
        passed.flat[free] = True
        self._passed |= passed
        self._hits[passed & (self._hits > 0)] -= 1
        self._hits.flat[solid] = HITS
        self._looked.flat[came] = False
        off = np.array([wrap(a - robot.yaw - self._view.centre) for a in angles.tolist()])
        is_in_view = np.abs(off) <= 0.9 * self._view.half
        self._looked.flat[free[is_in_view[beams] & (steps[along] <= self._far)]] = True
        self._looked.flat[solid[is_in_view[hits] & (ranges[hits] <= self._far)]] = True
        self._things = _free_standing(scan, ranges, lidar)

    def _cells(self, xy: Floats) -> Indices:
        """Return the flat indices of the cells of points; points off the map are in its margin."""
        cells = np.clip(((xy - self._origin) / CELL_M).astype(np.intp), 0, CELLS - 1)
        return np.asarray(cells[:, 0] * CELLS + cells[:, 1])

    def _middles(self, cells: Indices | int) -> Floats:
        """Return the middles of cells (n, 2), or of one (2) [m]."""
        middles: Floats = self._origin + CELL_M * (np.stack(np.divmod(cells, CELLS), -1) + 0.5)
        return middles

    def look(self, robot: Pose2D, strangers: Iterable[tuple[float, float]] = ()) -> Look | None:
        """Return where to drive and look next; None if there is nothing left to look at.

        Args:
            robot: Pose of the robot in odom.
            strangers: Positions of the people who are known not to be the person, in odom.
        """
        solid, at = self._hits > 0, np.array(robot[:2])
        free = self._passed & ~solid
        start = self._cells(at[None])
        passable = free & ~dilated(solid, self._tight)
        if not passable.flat[start[0]]:  # nearer to an obstacle than on any way
            around = np.zeros_like(solid)
            around.flat[start] = True
            passable |= ~solid & dilated(around, self._tight)
        steps = waves(passable, start)
        reachable = np.flatnonzero(steps >= 0)
        hidden = ~dilated(self._passed | solid, _disc(1.5))
        edges = free & dilated(hidden, _disc(2.0)) & ~self._tried
        openings = reachable[edges.flat[reachable]]
        known = (self._looked | self._tried).flat[self._cells(self._things)]
        things = self._things[~known]
        for stranger in strangers:
            things = things[np.hypot(*(things - stranger).T) > APART_M]
        places = np.concatenate((self._middles(openings), things))
        middles, lengths = self._middles(reachable), steps.flat[reachable] * CELL_M
        off = np.hypot(*np.moveaxis(things[:, None] - middles, -1, 0))
        costs = np.concatenate((steps.flat[openings] * CELL_M, (lengths + off).min(axis=1)))
        costs += np.hypot(*(places - self._expected).T)
        place, is_thing = self._last, False
        if place is not None:
            is_same = np.hypot(*(places - place).T) <= APART_M
            costs -= LOYALTY_M * is_same
            self._misses = 0 if is_same.any() else self._misses + 1
        if place is None or not 0 < self._misses <= MISSES or math.dist(place, at) <= APART_M:
            if not len(places):
                self._last = None
                return None
            best = int(np.argmin(costs))
            place, is_thing = places[best], best >= len(openings)
            self._misses = MISSES if is_thing else 0
        self._try(at, place)
        self._last = place
        nearest = int(reachable[np.argmin(np.hypot(*(middles - place).T))])
        way = self._way(steps, nearest, at, passable)
        # beside a wall or the post of a door the guard may hold a robot that turns: drive on first
        cramped = self._looks > HESITATES or bool(dilated(solid, self._wide).flat[start[0]])
        if not self._is_clear(free, at, place, 2.5 * CELL_M):
            place = way
        elif is_thing and math.dist(place, at) < self._far and not cramped:
            way = at
        if cramped and math.dist(way, at) > CELL_M / 4:
            place = at
        reason = "something like legs" if is_thing else "an opening"
        return Look(tuple(way.tolist()), tuple(place.tolist()), reason)

    def _try(self, at: Floats, place: Floats) -> None:
        """Give up a place if the robot neither comes nearer nor sees it."""
        is_new = self._last is None or math.dist(place, self._last) > APART_M
        if is_new or math.dist(at, self._halt) > APART_M / 2:
            self._halt, self._looks = at, 0
        self._looks += 1
        if self._looks > TRIES:
            around = np.zeros_like(self._tried)
            around.flat[self._cells(place[None])] = True
            self._tried |= dilated(around, _disc(APART_M / CELL_M))

    def _is_clear(self, cells: Cells, begin: Floats, end: Floats, but: float = 0.0) -> bool:
        """Return whether a line, but for a part of its ends [m], leads through some cells."""
        length = math.dist(begin, end)
        along = np.arange(but, length - but, CELL_M / 2)
        line = begin + (end - begin) * (along / max(length, CELL_M))[:, None]
        return bool(cells.flat[self._cells(line)].all())

    def _way(self, steps: Indices, cell: int, at: Floats, passable: Cells) -> Floats:
        """Return the farthest point on the way to a cell to which a straight line leads."""
        while steps.flat[cell] > 0 and not self._is_clear(passable, at, self._middles(cell)):
            around = cell + NEIGHBOURS
            around = around[steps.flat[around] >= 0]
            cell = int(around[np.argmin(steps.flat[around])])
        return self._middles(cell)


def _free_standing(scan: LaserScan, ranges: Floats, lidar: Pose2D) -> Floats:
    """Return the middles of what may be legs, in odom: narrow, and nearer than all beside it."""
    seen = clusters(scan, ranges, FREE_STANDING_M, REACH_M)
    if not len(seen.xy):
        return seen.xy
    first, last = seen.xy[seen.starts], seen.xy[seen.starts + seen.counts - 1]
    may_be = (seen.width <= STRIDE_M) & (seen.counts >= 2)
    for end, beside in ((first, np.roll(last, 1, axis=0)), (last, np.roll(first, -1, axis=0))):
        away, to = np.hypot(*end.T), np.hypot(*beside.T)
        sine = np.abs(end[:, 0] * beside[:, 1] - end[:, 1] * beside[:, 0]) / (away * to)
        may_be &= (to > away) | (sine > BESIDE_BEAMS * abs(scan.angle_increment))
    return compose(lidar, seen.middle[may_be])


NEIGHBOURS = np.array([1, -1, CELLS, -CELLS, CELLS + 1, CELLS - 1, 1 - CELLS, -CELLS - 1])


def waves(passable: Cells, start: Indices) -> Indices:
    """Return the number of steps from a cell to each passable one; -1 where there is no way.

    Even steps go to four neighbours and odd ones to eight, so that waves are octagons.
    """
    steps = np.full(passable.shape, -1)
    inside = passable.copy()
    inside[[0, -1]] = inside[:, [0, -1]] = False
    front, number = start, 0
    while len(front):
        steps.flat[front] = number
        number += 1
        around = (front[:, None] + NEIGHBOURS[: 4 if number % 2 else 8]).ravel()
        front = np.unique(around[inside.flat[around] & (steps.flat[around] < 0)])
    return steps


def _disc(radius: float) -> list[tuple[int, int]]:
    size = math.floor(radius)
    span = range(-size, size + 1)
    return [(i, j) for i in span for j in span if i * i + j * j <= radius * radius]


def dilated(cells: Cells, disc: list[tuple[int, int]]) -> Cells:
    """Return the cells within a disc about any of some cells."""
    size = max(i for i, _ in disc)
    padded, result = np.pad(cells, size), np.zeros_like(cells)
    for i, j in disc:
        result |= padded[size + i : size + i + CELLS, size + j : size + j + CELLS]
    return result
