"""Limits a wanted twist so that the robot can stop before it touches anything.

Before each tick the robot's motion is predicted: it follows the twist for a tick and for the
reaction time, then every axis brakes as the controller brakes it. The reaction time includes the
time for which the robot obeys a silent guard. A twist is safe if in that time the robot's outline
keeps its margin from every point, or comes no nearer than by braking at once. So rest is always a
safe twist, and motion away from all near points is never limited. The idea is the inevitable
collision states of T. Fraichard & H. Asama, Advanced Robotics 18, 2004.
"""

from __future__ import annotations

import math
from copy import copy
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.arrays import to_rectangle
from mecazen.drive import UNLIMITED, Drive, LimiterState, bounds, slow_down
from mecazen.geometry import Twist2D
from mecazen.portable import Floats

BRAKING = 0.9
"""Share of the deceleration limit that the prediction assumes: the wheels lag a little."""
STEP_M = 0.04
"""Maximum motion of a corner between predicted poses, as far as MOST_GROUPS allow [m]."""
SEARCHED = 3
"""Step of the search through the poses; the result is then checked against all poses."""
LEAST_GROUPS, MOST_GROUPS = 2, 8
SHARES = np.array((0.04, 0.1, 0.2, 0.35, 0.5, 0.65, 0.78, 0.87, 0.93, 0.97, 1.0))
"""Shares of the allowed maximum that the search tries, with small steps near 1: the share usually
changes little from tick to tick."""
LEAST_SHARE = 1e-3
"""A smaller share becomes rest."""
FALLBACK = np.array((1.0, 0.96, 0.8))
"""Shares of the search's result that are checked against all poses."""
RECOVERY_S = 0.5
"""Minimum time in which the share grows from 0 to 1: noise of the lidar causes no chatter [s]."""
PERSON_STOP_S = 0.3
"""Shortest time in which a walking person can come to rest."""
TOLERANCE_M = 1e-6
BESIDE_M = 0.15
"""The search ignores points whose clearance exceeds the required one by this much [m]."""
NO_POINTS = np.empty((0, 2))


class Points(NamedTuple):
    """N points that the robot must not touch, in one frame."""

    xy: Floats = NO_POINTS
    """Positions (N, 2) [m]."""
    velocity: Floats = NO_POINTS
    """Velocities (N, 2) [m/s]."""
    margin: Floats = np.empty(0)
    """The clearance to keep from each point [m]."""
    stops: npt.NDArray[np.bool_] = np.empty(0, bool)
    """Whether the point stops within `PERSON_STOP_S`, instead of continuing at its velocity."""

    def only(self, which: npt.NDArray[Any]) -> Points:
        """Return some of the points, by index or by flag."""
        return Points(*(values[which] for values in self))


class Verdict(NamedTuple):
    """The twist that the guard lets through, in base_link."""

    twist: Twist2D
    factor: float = 1.0
    """Share of the wanted twist."""
    distance: float = math.inf
    """Distance from the outline to the nearest point, or to the blocking point if there is one
    [m]."""
    bearing: float = 0.0
    """Bearing of that point from the x axis [rad]."""


class Guard:
    """Decides tick by tick, with a model of how the controller follows the twist.

    The footprint is half the length and half the width of the robot [m]; the wheels follow a
    decision after `reaction_s`.
    """

    def __init__(self, footprint: tuple[float, float], drive: Drive, reaction_s: float) -> None:
        self.footprint = footprint
        self._corner = math.hypot(*footprint)
        self.configure(drive, reaction_s)
        self.begin(Twist2D())

    def configure(self, drive: Drive, reaction_s: float) -> None:
        """Continue with changed limits and times; see `Guard`."""
        self._drive = drive
        self._gains = np.array((1.0, drive.sideways, drive.lever))[:, None, None]
        self._reaction_s = reaction_s + max(
            (axis.acceleration + axis.deceleration) / axis.jerk if axis.jerk < math.inf else 0.0
            for axis in drive.axes
        )
        self._up, self._down = (
            [min(getattr(axis, name), UNLIMITED) for axis in drive.axes]
            for name in ("acceleration", "deceleration")
        )
        self._changes = np.array((self._up, self._down))[..., None]
        self._fastest = np.array([axis.velocity for axis in drive.axes])
        self._lowest = np.array([axis.lowest for axis in drive.axes])

    def begin(self, twist: Twist2D) -> None:
        """Restart with a robot that moves with `twist`."""
        x, y, yaw = map(LimiterState, twist)
        self._state = (x, y, yaw)
        self._let_through = twist
        self._factor = self._last_factor = 1.0
        self._dt = 0.0

    def step(self, wanted: Twist2D, points: Points, age_s: float, dt: float) -> Verdict:
        """Return the verdict of a tick of `dt` [s]; with 0 the current tick is decided again.

        The points, in base_link, were measured `age_s` before.
        """
        if dt > 0.0:
            self._state = self._drive.limited(self._state, self._let_through, dt)
            self._last_factor, self._dt = self._factor, dt
        verdict = self._decide(wanted, points, age_s)
        self._let_through, self._factor = verdict.twist, verdict.factor
        return verdict

    def _decide(self, wanted: Twist2D, points: Points, age_s: float) -> Verdict:
        if not len(points.xy):
            return Verdict(wanted)
        clear = Verdict(wanted, 1.0, *self._nearest(points.xy))
        if wanted == Twist2D():
            return clear
        moving = [axis.velocity for axis in self._state]
        hold = self._dt + self._reaction_s
        speeds = [
            max(abs(speed), min(abs(aim), abs(speed) + up * hold))
            for speed, aim, up in zip(moving, wanted, self._up, strict=True)
        ]
        braking = [speed / (BRAKING * down) for speed, down in zip(speeds, self._down, strict=True)]
        paths = [s * (hold + time / 2.0) for s, time in zip(speeds, braking, strict=True)]
        horizon = hold + max(braking)
        # the middle stays in a box, for any turn of the robot; the outline in a circle about it
        reach = points.margin + self._corner + min(paths[2], 2.0) * math.hypot(paths[0], paths[1])
        reach += (horizon + age_s) * np.hypot(points.velocity[:, 0], points.velocity[:, 1])
        off = []
        for axis in (0, 1):
            low = -paths[axis] if min(moving[axis], wanted[axis]) < 0.0 else 0.0
            high = paths[axis] if max(moving[axis], wanted[axis]) > 0.0 else 0.0
            along = points.xy[:, axis]
            off.append(along - np.minimum(np.maximum(along, low), high))
        (near,) = np.nonzero(off[0] * off[0] + off[1] * off[1] <= reach * reach)
        if not len(near):
            return clear
        points = points.only(near)
        fastest = math.hypot(speeds[0], speeds[1]) + self._corner * speeds[2]  # of a corner
        groups = math.ceil(horizon * fastest / (STEP_M * SEARCHED))
        count = SEARCHED * min(max(groups, LEAST_GROUPS), MOST_GROUPS)
        times = horizon / count * np.arange(1.0, count + 1.0)
        envelope = self._envelope(np.array(moving), hold, times)
        twist = np.array(wanted)
        encounter = _Encounter(self, points, times, age_s, envelope, twist)
        return self._limited(twist, points, encounter, clear)

    def _limited(
        self, twist: Floats, points: Points, encounter: _Encounter, clear: Verdict
    ) -> Verdict:
        """Return the largest safe share of the twist, or of its part past the blocking point."""
        recovered = min(self._last_factor + self._dt / RECOVERY_S, 1.0)
        worst = int(np.argmin(encounter.whole))
        if encounter.whole[worst] >= 0.0:
            part = recovered * twist
            is_free = recovered == 1.0 or not encounter.approaches
            if is_free or encounter.spare(part[None]).min() < 0.0:
                return clear
            return clear._replace(twist=Twist2D(*part.tolist()), factor=recovered)
        search = encounter.among(encounter.whole < BESIDE_M)
        share, best = search.share(twist, recovered), twist
        past = self._past(twist, points.xy[worst])
        if past is not None and (length := _square(past) / _square(twist)) > share:
            sidestep = search.share(past, min(recovered / length, 1.0)) * length
            if sidestep > share:
                share, best = sidestep, past / length
        shares = share * FALLBACK
        is_safe = encounter.spare(shares[:, None] * best).min(axis=1) >= 0.0
        share = float(shares[np.argmax(is_safe)]) if is_safe.any() else 0.0
        if share < LEAST_SHARE:
            share = 0.0
        blocking = self._nearest(points.xy[worst : worst + 1])
        return Verdict(Twist2D(*(share * best).tolist()), share, *blocking)

    def _nearest(self, xy: Floats) -> tuple[float, float]:
        """Return the distance of the nearest point from the outline, and its bearing."""
        from_middle = np.hypot(xy[:, 0], xy[:, 1])
        near = xy[from_middle <= from_middle.min() + self._corner - min(self.footprint)]
        clearances = to_rectangle(near[:, 0], near[:, 1], self.footprint)
        least = int(clearances.argmin())
        x, y = near[least].tolist()
        return float(clearances[least]), math.atan2(y, x)

    def _past(self, twist: Floats, point: Floats) -> Floats | None:
        """Return the twist without its part towards a point; None if either part is zero."""
        half = np.array(self.footprint)
        away = point - np.clip(point, -half, half)
        distance = math.hypot(*away)
        if distance == 0.0:
            return None
        normal = away / distance
        towards = float(np.sum(twist[:2] * normal))
        if towards <= 0.0:
            return None
        past = twist.copy()
        past[:2] -= towards * normal
        return past if np.any(np.abs(past) > 1e-3) else None

    def _envelope(self, moving: Floats, hold: float, times: Floats) -> tuple[Floats, ...]:
        """Return lower and upper speed bounds, and the braking, before M times: (3, 1, M) each."""
        up, down = self._changes
        middles = times - times[0] / 2.0
        growing = np.minimum(middles, hold)
        low, high = bounds(moving[:, None], up * growing, down * growing)
        braked = BRAKING * down * np.maximum(middles - hold, 0.0)
        return low[:, None], high[:, None], braked[:, None]

    def moved(
        self, twists: Floats, envelope: tuple[Floats, ...], step_s: float
    ) -> tuple[Floats, Floats, Floats]:
        """Return x, y [m] and yaw [rad] (C, M) in base_link, in intervals of `step_s` [s].

        The robot follows each of C twists (C, 3) within the bounds of an envelope and the limits of
        its axes.
        """
        low, high, braked = envelope
        aims = np.minimum(np.maximum(twists, self._lowest), self._fastest)
        speeds = np.minimum(np.maximum(aims.T[..., None], low), high)
        speeds -= np.minimum(np.maximum(speeds, -braked), braked)
        slow_down(speeds, self._gains, min(self._drive.rim_speed, UNLIMITED))
        dx, dy, turn = speeds * step_s
        yaw = turn.cumsum(axis=-1)
        between = yaw - turn / 2.0
        c, s = np.cos(between), np.sin(between)
        return (c * dx - s * dy).cumsum(axis=-1), (s * dx + c * dy).cumsum(axis=-1), yaw


def _square(vector: Floats) -> float:
    return float(np.sum(vector * vector))


class _Encounter:
    """The near points of a tick: their predicted motion, and the clearance that each requires."""

    def __init__(
        self,
        guard: Guard,
        points: Points,
        times: Floats,
        age_s: float,
        envelope: tuple[Floats, ...],
        twist: Floats,
    ) -> None:
        self._guard, self._envelope, self._step_s = guard, envelope, float(times[0])
        xy = points.xy[None]
        if points.velocity.any():
            gone = (times + age_s)[:, None]
            braking = np.minimum(gone, PERSON_STOP_S)
            lasting = np.where(points.stops, braking - braking**2 / (2.0 * PERSON_STOP_S), gone)
            xy = xy + points.velocity * lasting[..., None]
        self._xy, self._every = xy, slice(None)
        self._at_rest, least = self._least(np.array((np.zeros(3), twist)))
        self._required = np.minimum(points.margin, self._at_rest - TOLERANCE_M)
        self.whole = least - self._required
        """`spare` of the commanded twist (N) [m]."""
        self.approaches = bool(np.any(least < self._at_rest - TOLERANCE_M))
        """Whether that twist comes nearer to a point than braking at once."""

    def _least(self, twists: Floats) -> Floats:
        """Return the least distance of each point from the outline (C, N) [m]; inside negative."""
        poses = self._guard.moved(twists, self._envelope, self._step_s)
        x, y, yaw = (values[:, self._every, None] for values in poses)
        c, s = np.cos(yaw), np.sin(yaw)
        off_x, off_y = self._xy[..., 0] - x, self._xy[..., 1] - y
        ahead, beside = c * off_x + s * off_y, c * off_y - s * off_x
        least: Floats = to_rectangle(ahead, beside, self._guard.footprint).min(axis=1)
        return least

    def spare(self, twists: Floats) -> Floats:
        """Return by how much each point's clearance exceeds the required one (C, N) [m]."""
        spare: Floats = self._least(twists) - self._required
        return spare

    def among(self, points: npt.NDArray[np.bool_]) -> _Encounter:
        """Return the encounter with some of the points, at every `SEARCHED`-th pose."""
        part = copy(self)
        part._every = slice(SEARCHED - 1, None, SEARCHED)
        xy = self._xy if len(self._xy) == 1 else self._xy[part._every]
        part._xy, part._required = xy[:, points], self._required[points]
        part._at_rest = self._at_rest[points]
        return part

    def share(self, twist: Floats, most: float) -> float:
        """Return the largest share, at most `most`, up to which all shares of a twist are safe."""
        shares = most * SHARES
        spare = self.spare(shares[:, None] * twist).min(axis=1)
        is_unsafe = spare < 0.0
        if not is_unsafe.any():
            return most
        first = int(np.argmax(is_unsafe))
        below = float((self._at_rest - self._required).min()), 0.0
        if first:
            below = float(spare[first - 1]), float(shares[first - 1])
        # linear interpolation is accurate enough, since the result is checked again
        part = 0.9 * below[0] / (below[0] - float(spare[first]))
        return below[1] + (float(shares[first]) - below[1]) * part
