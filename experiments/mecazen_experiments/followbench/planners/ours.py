"""Our planner for the unicycle of Follow-Bench: sampled paths, with priority on no contact.

The idea is that of `mecazen_follower.planner` without lateral motion: paths are sampled around the
last plan and from a fixed library, and the cheapest path is driven for a step. Little else can be
shared. The follower's rollouts have the limits of four wheels, while this robot stops, and starts
from rest, in one step. The follower's costs weigh bearing, heading and a camera's view, which do
not count here. Its table of distances reaches 3.3 m, while plans here reach 5 m.

Three facts about the benchmark decide the costs. Any contact fails an episode, even if a person
caused it, so clearance from people counts most and the place by the target little. People walk into
a robot that stands. They avoid a disc of 0.9 m around its axle, while its front reaches 0.6 m
ahead: a robot that turns its rear to people and backs up is rarely touched. A contact is checked
after the robot's own move, before people move, so the first pose of a path is compared with the
present positions of people.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.portable import Floats
from scipy.ndimage import distance_transform_edt

from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.planners.scan import points
from mecazen_experiments.followbench.planners.ways import STEPS, TIMES, Ways, roll, sample
from mecazen_experiments.followbench.planners.whereabouts import Whereabouts
from mecazen_experiments.followbench.unicycle import CENTRE, HALF, PERSON_RADIUS
from mecazen_experiments.followbench.view import View

NEAR_M, MOST = 4.0, 12
"""Maximum range [m] and maximum number of the people that are considered."""
PERSON_M = 0.1
"""A point of the scan this near to a visible person's outline belongs to the person."""
TOUCHING_M = 0.02
"""Gap that counts as a contact in a plan ..."""
TOUCHING_NOW_M = 0.003
"""... and in its first step, for which people's positions are certain."""
CELL_M, CELLS = 0.1, 105
"""Cell size [m] and cells per side of the table of wall distances: 5.2 m to each side."""
DISCS_M = CENTRE - HALF[0] / 2, CENTRE + HALF[0] / 2
"""Centres of two discs that enclose the halves of the outline, ahead of the axle ..."""
DISC_M = math.hypot(HALF[0] / 2, HALF[1])
"""... and their radius."""
FIT_M, CHECKS = 0.3, 50
"""Clearance from walls that a straight path needs, and number of points at which it is checked."""
AFTER = 4
"""Number of steps whose jerk is penalised."""


class Weights(NamedTuple):
    """Costs, and the distances over which they act."""

    touch: float = 1000.0
    """Cost of a contact at a time of a path; ten times that in the first step."""
    near: float = 30.0
    """Cost of a person at the outline; falls to 0 at ..."""
    margin_m: float = 0.45
    growth_m_s: float = 0.1
    """... the margin, which grows with time for 1.5 s."""
    patience_s: float = 3.0
    """Time without sight of the target after which proximity to people costs half: people who wait
    for a robot that blocks a door give way when it approaches."""
    wall: float = 30.0
    wall_margin_m: float = 0.25
    fade_s: float = 1.2
    """Time after which costs of predictions count half."""
    place: float = 1.0
    place_m: float = 0.7
    """Error of the place at which the cost is `place`; beyond it, the cost grows linearly."""
    far: float = 30.0
    far_m: float = 3.8
    """Distance from the target beyond which `far` penalises the risk of losing it."""
    jerk: float = 0.8
    turn: float = 0.02


class Ours:
    """A follower that drives the cheapest of sampled paths, step by step."""

    def __init__(self, weights: Weights = Weights()) -> None:  # noqa: B008  # immutable
        self._weights = weights
        self._fade = 1.0 / (1.0 + (TIMES / weights.fade_s) ** 2)
        self._margin = weights.margin_m + weights.growth_m_s * np.minimum(TIMES, 1.5)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode, and seed the samples."""
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._target = Whereabouts()
        self._plan: tuple[Floats, Floats] | None = None
        self._moved = (0.0, 0.0), (0.0, 0.0)

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""
        self._target.update(view)
        v, w, gentle = sample(self._plan, self._random)
        ways = roll(view.robot, (view.v, view.w), (v, w), gentle)
        walls = Walls(view)
        cost = self._people(view, ways) + self._walls(walls, ways)
        cost += self._place(view, walls, ways) + self._smoothness(view, ways)
        best = int(cost.argmin())
        self._plan = ways.v[best], ways.w[best]
        v0, w0 = float(ways.v[best, 0]), float(ways.w[best, 0])
        velocity = v0 * math.cos(view.robot.yaw), v0 * math.sin(view.robot.yaw)
        self._moved = velocity, self._moved[0]
        return v0, w0

    def _people(self, view: View, ways: Ways) -> Floats:
        """Return the cost of each path (n) for proximity to people, who walk straight on."""
        nearest = sorted((math.dist(person[:2], view.robot[:2]), person) for person in view.people)
        people = [person for distance, person in nearest[:MOST] if distance < NEAR_M]
        if view.target is not None:
            people.append(view.target)
        if not people:
            return np.zeros(len(ways.x))
        x, y, vx, vy = np.array(people).T
        # the robot moves first: its pose after a step is compared with people before that step
        when = (TIMES - STEP_S)[:, None]
        dx, dy = x + when * vx - ways.x[..., None], y + when * vy - ways.y[..., None]
        c, s = ways.c[..., None], ways.s[..., None]
        over = np.maximum(np.abs(c * dx + s * dy - CENTRE) - HALF[0], 0.0)
        beside = np.maximum(np.abs(c * dy - s * dx) - HALF[1], 0.0)
        gaps = np.sqrt(over * over + beside * beside) - PERSON_RADIUS
        near = np.maximum(1.0 - gaps / self._margin[:, None], 0.0)
        least = gaps.min(axis=2)
        weights = self._weights
        shyness = weights.near / (1.0 + self._target.unseen_s / weights.patience_s)
        cost: Floats = shyness * (self._fade * (near * near).sum(axis=2)).mean(axis=1)
        cost += weights.touch * (self._fade * (least < TOUCHING_M)).mean(axis=1)
        cost += 10.0 * weights.touch * (least[:, 0] < TOUCHING_NOW_M)
        return cost

    def _walls(self, walls: Walls, ways: Ways) -> Floats:
        """Return the cost of each path (n) for proximity to scan points that are not people."""
        if walls.table is None:
            return np.zeros(len(ways.x))
        gaps = np.full_like(ways.x, np.inf)
        for ahead in DISCS_M:
            x, y = ways.x + ahead * ways.c, ways.y + ahead * ways.s
            np.minimum(gaps, walls.distance(x, y), out=gaps)
        gaps -= DISC_M
        weights = self._weights
        near = np.maximum(1.0 - gaps / weights.wall_margin_m, 0.0)
        cost: Floats = weights.wall * (self._fade * near * near).mean(axis=1)
        cost += weights.touch * (gaps < 0.0).mean(axis=1)
        cost += 10.0 * weights.touch * (gaps[:, 0] < 0.0)
        return cost

    def _place(self, view: View, walls: Walls, ways: Ways) -> Floats:
        """Return the cost of each path (n) for errors of place, and distance from the target."""
        target = self._target
        if target.last is None:
            return np.zeros(len(ways.x))
        goals, is_seen = self._goals(walls)
        dx, dy = ways.x - goals[:, 0], ways.y - goals[:, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        if not is_seen:
            error = distance
        elif view.place == "back":
            error = np.abs(distance - view.distance)
        else:
            c, s = math.cos(target.heading), math.sin(target.heading)
            across, along = np.abs(c * dy - s * dx) - view.distance, c * dx + s * dy
            error = np.sqrt(across * across + along * along)
        weights = self._weights
        error = error / weights.place_m
        near = np.minimum(error, 1.0)
        later = np.linspace(0.5, 1.5, STEPS)
        cost: Floats = weights.place * (later * near * (2.0 * error - near)).mean(axis=1)
        if is_seen:
            far = np.maximum(distance - weights.far_m, 0.0)
            cost += weights.far * (far * far).mean(axis=1)
        return cost

    def _goals(self, walls: Walls) -> tuple[Floats, bool]:
        """Return the goal at each time (STEPS, 2), and whether it is the visible target.

        If a wall is between the robot and an unseen target, the robot follows the target's trail
        round the wall. At the end of the trail, the robot searches at guesses that it can reach.
        """
        target = self._target
        is_seen = not target.unseen_s
        if is_seen or walls.table is None or walls.is_free(target.guesses()[:1])[0]:
            return target.ahead(TIMES), is_seen
        if target.trail:
            places = np.array(target.trail)
            free = np.flatnonzero(walls.is_free(places))
            return np.repeat(places[[free[-1] if len(free) else 0]], STEPS, axis=0), False
        free = np.flatnonzero(walls.is_free(target.guesses()))
        if not len(free):
            target.restart()
        return target.ahead(TIMES, int(free[0]) if len(free) else 0), False

    def _smoothness(self, view: View, ways: Ways) -> Floats:
        """Return the cost of each path (n) for jerk and for turning."""
        (x, y), (last_x, last_y) = self._moved
        cost: Floats = self._weights.turn * (ways.w * ways.w).mean(axis=1)
        c, s = math.cos(view.robot.yaw), math.sin(view.robot.yaw)
        vx: list[Floats | float] = [last_x, x, ways.v[:, 0] * c]
        vy: list[Floats | float] = [last_y, y, ways.v[:, 0] * s]
        for k in range(AFTER):
            if k:
                vx.append(ways.v[:, k] * ways.c[:, k - 1])
                vy.append(ways.v[:, k] * ways.s[:, k - 1])
            jx = vx[k + 2] - 2.0 * vx[k + 1] + vx[k]
            jy = vy[k + 2] - 2.0 * vy[k + 1] + vy[k]
            cost += self._weights.jerk * np.sqrt(jx * jx + jy * jy)
        return cost


class Walls:
    """Distances from scan points that are not people."""

    def __init__(self, view: View) -> None:
        self._x, self._y = view.robot[:2]
        self.table: Floats | None = None
        """Distance of each cell from the nearest wall [m]; None without walls."""
        things = _things(view)
        if len(things):
            free = np.ones((CELLS, CELLS), bool)
            free[_cells(things[:, 0] - self._x), _cells(things[:, 1] - self._y)] = False
            self.table = (CELL_M * distance_transform_edt(free)).ravel()

    def distance(self, x: Floats, y: Floats) -> Floats:
        """Return the distances [m] of positions in the world from the nearest wall."""
        assert self.table is not None
        return self.table.take(_cells(x - self._x) * CELLS + _cells(y - self._y))

    def is_free(self, places: Floats) -> npt.NDArray[np.bool_]:
        """Return whether the robot fits between walls on straight paths to positions (n, 2)."""
        share = np.linspace(0.0, 1.0, CHECKS)
        dx, dy = places[:, :1] - self._x, places[:, 1:] - self._y
        gaps = self.distance(self._x + share * dx, self._y + share * dy)
        free: npt.NDArray[np.bool_] = gaps.min(axis=1) > FIT_M
        return free


def _things(view: View) -> Floats:
    """Return the points of the scan (n, 2) [m] that belong to no visible person."""
    things = points(view)
    people = [*view.people] + ([view.target] if view.target is not None else [])
    if not people or not len(things):
        return things
    x, y = np.array([person[:2] for person in people]).T
    dx, dy = things[:, :1] - x, things[:, 1:] - y
    is_person = (dx * dx + dy * dy < (PERSON_RADIUS + PERSON_M) ** 2).any(axis=1)
    others: Floats = things[~is_person]
    return others


def _cells(offsets: Floats) -> npt.NDArray[np.int64]:
    """Return the cells of the table at offsets from the robot along an axis [m]."""
    cells: npt.NDArray[np.int64] = np.rint(offsets / CELL_M).astype(np.int64) + CELLS // 2
    return np.minimum(np.maximum(cells, 0), CELLS - 1)
