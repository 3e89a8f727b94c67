"""Data association: which detection is the person, by a gate, the likeliest track, and doubt.

People walk and do not jump. So a detection outside the gate of the person's track is another
person, who gets a separate track and is not mistaken for the person later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from mecazen.geometry import Pose2D, wrap
from mecazen.messages import PlanarCovariance

from mecazen_follower.estimators import Estimate
from mecazen_follower.measurement import Measurement, has_heading

GATE = 25.0
"""Gate of the squared Mahalanobis distance in the plane: 1 in 270,000 true detections is beyond."""
NAMELESS_GATE = 9.0
"""The same gate for pairs of legs, which have no id: one leg of each of two people can be taken for
a person between both. 1 in 90 true detections is beyond."""
APART_M = 0.5
"""Minimum distance between two people [m]. A detection that is nearer to the person, or to the path
that is predicted for the person while out of sight, is the person."""
SAME_ID = 6.0
"""Bonus of an equal id, as a squared distance: a hint, which can't open the gate."""
CONFIRMED = 4
"""Number of frames after which the person's track is trusted more than a detection against it."""
DOUBT_S = 0.3
"""Time after which detections that contradict the track in every frame replace it [s]; they must
also last for `CONFIRMED` frames."""
WALKING_M_S = 0.1
"""Forward speed above which a reversed heading is the sensor's error, however long it lasts."""
FORGET_S = 1.0
"""Time after which another person who is not seen is forgotten [s]."""
STILL_M, STANDING_S = 0.25, 1.0
"""A track that stays within this distance of a place for this time stands: it may be a thing, such
as a box that looks like legs."""
STANDING_GAIN = 0.2
"""Gain of the position of a track that stands: too small for a person who walks by."""
HIDDEN_S = 5.0
"""Time after which a track that stands is forgotten: the person may hide it for so long [s]."""
OTHER_SPEED_STD_M_S, OTHER_ACCELERATION_STD_M_S2 = 1.0, 2.0
"""Prior and random walk of the velocity of other people."""
CROWD = 30
"""Maximum number of detections per frame, nearest first; the work grows with its square."""
FLIP_PROBABILITY = 0.03
"""Probability that a tracker confuses front and back."""


class Track:
    """The track of another person or thing, with the same variance along both axes.

    It has a constant velocity, or it stands.
    """

    def __init__(self, time: float, seen: Measurement) -> None:
        self.seen_at = time
        self._identity = seen.identity
        self._x, self._y = seen.pose.x, seen.pose.y
        self._vx = self._vy = 0.0
        self._variances = spread(seen.covariance), 0.0, OTHER_SPEED_STD_M_S**2
        """Variance of the position, its covariance with the velocity, variance of the velocity."""
        self._time = time
        self._place = self._x, self._y, time
        """Position and time since which the track is near it."""

    @property
    def stands(self) -> bool:
        """Whether the track has been near a place for `STANDING_S`."""
        return self.seen_at - self._place[2] >= STANDING_S

    @property
    def is_old(self) -> bool:
        """Whether the track has not been seen for too long."""
        return self._time - self.seen_at > (HIDDEN_S if self.stands else FORGET_S)

    def predict(self, time: float) -> None:
        """Propagate to a time [s]."""
        dt, (pp, pv, vv) = time - self._time, self._variances
        self._time = time
        if self.stands:
            return
        self._x += self._vx * dt
        self._y += self._vy * dt
        q = OTHER_ACCELERATION_STD_M_S2**2 * dt
        self._variances = (
            pp + (2.0 * pv + vv * dt) * dt + q * dt * dt / 3.0,
            pv + vv * dt + q * dt / 2.0,
            vv + q,
        )

    def claims(self, seen: Measurement) -> bool:
        """Return whether a detection is where this track stands."""
        return self.stands and math.dist((self._x, self._y), seen.pose[:2]) <= STILL_M

    def cost(self, seen: Measurement) -> float:
        """Return the cost of assigning a detection to this track; infinite outside the gate."""
        variance = self._variances[0] + spread(seen.covariance)
        distance = ((seen.pose.x - self._x) ** 2 + (seen.pose.y - self._y) ** 2) / variance
        if distance >= GATE:
            return math.inf
        return distance + 2.0 * math.log(variance) - hint(self._identity, seen)

    def update(self, seen: Measurement) -> None:
        """Correct with a measurement."""
        pp, pv, vv = self._variances
        noise = spread(seen.covariance)
        gain, rate = pp / (pp + noise), pv / (pp + noise)
        if self.stands:  # only the side that the robot sees changes
            gain, rate, self._vx, self._vy = STANDING_GAIN, 0.0, 0.0, 0.0
        else:
            self._variances = gain * noise, rate * noise, vv - rate * pv
        dx, dy = seen.pose.x - self._x, seen.pose.y - self._y
        self._x, self._y = self._x + gain * dx, self._y + gain * dy
        self._vx, self._vy = self._vx + rate * dx, self._vy + rate * dy
        self.seen_at = self._time
        self._identity = seen.identity or self._identity
        if math.dist(self._place[:2], (self._x, self._y)) > STILL_M:
            self._place = self._x, self._y, self._time


class Association:
    """Chooses the person's measurement of every frame.

    After `patience` [s] without the person, the nearest detection becomes the person.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self.reset()

    def reset(self) -> None:
        """Forget all people."""
        self._others: list[Track] = []
        self._forget_person()

    def _forget_person(self) -> None:
        self._identity = ""
        self._last = Pose2D()
        self._hits = 0
        self._contradicted = Contradiction()
        self._flipped = Contradiction()

    def choose(
        self,
        time: float,
        person: Estimate | None,
        expected: Pose2D,
        seen: Sequence[Measurement],
        *,
        unseen: float,
        lost: bool,
        begins: bool = True,
    ) -> tuple[Measurement, bool] | None:
        """Return the person's measurement, and whether it restarts their track.

        A restart replaces a track that is wrong or too old. None if no measurement of the frame is
        the person's.

        Args:
            time: Time of the frame's capture [s].
            person: The person's estimate at `time`; None if the person was never seen.
            expected: The person's pose if the robot were at its goal: without an estimate, the
                measurement nearest to this pose is the person's.
            seen: The frame's measurements, each with a known covariance.
            unseen: Time since the person was last seen [s].
            lost: Whether `unseen` is too long for a useful estimate.
            begins: Whether the frame may restart the person's track.
        """
        if not seen:
            return None
        if len(seen) > CROWD:
            place = expected if person is None else person.pose
            seen = sorted(seen, key=lambda one: one.pose.distance(place))[:CROWD]
        if person is None:
            return self._restart(nearest(seen, expected))
        if unseen > self._patience:
            return self._restart(nearest(seen, person.pose))
        mine, rest = self._assign(time, person, seen, GATE if begins else NAMELESS_GATE)
        last = self._last if unseen > DOUBT_S else person.pose
        # a person out of sight may have stopped anywhere on the predicted path
        far = [one for one in rest if from_line(one.pose, last, person.pose) >= APART_M]
        if mine is not None:
            self._add(time, far)
            if begins:
                self._contradicted = Contradiction()
            return self._accept(time, person, mine)
        if not rest:
            return None  # all are known to be other people
        named = [one for one in rest if one.identity and one.identity == self._identity]
        found = nearest(named or rest, person.pose)
        if begins:
            self._contradicted = self._contradicted.again(time)
        near = bool(named) or from_line(found.pose, last, person.pose) < APART_M
        if begins and (lost or self._hits < CONFIRMED or (near and self._contradicted.lasts(time))):
            return self._restart(found)
        self._add(time, far)
        return None

    def _add(self, time: float, seen: Sequence[Measurement]) -> None:
        """Begin tracks of other people."""
        self._others = [*self._others, *(Track(time, one) for one in seen)][-CROWD:]

    def _assign(
        self, time: float, person: Estimate, seen: Sequence[Measurement], gate: float
    ) -> tuple[Measurement | None, list[Measurement]]:
        """Return the person's measurement and those without a known track; update other tracks.

        Pairs of track and measurement are taken in the order of their likelihood, those with what
        stands first: a person who is hidden behind a thing is not the thing.
        """
        for other in self._others:
            other.predict(time)
        self._others = [other for other in self._others if not other.is_old]
        tracks: list[Track | None] = [None, *self._others]
        named = any(one.identity and one.identity == self._identity for one in seen)
        pairs = []
        for i, one in enumerate(seen):
            for j, track in enumerate(tracks):
                if track is None and named and one.identity != self._identity:
                    continue  # a sensor does not see a person twice
                cost = self._cost(person, one, gate) if track is None else track.cost(one)
                if cost < math.inf:
                    pairs.append((track is None or not track.claims(one), cost, i, j))
        mine, taken, used = None, set[int](), set[int]()
        for _, _, i, j in sorted(pairs):
            if i in taken or j in used:
                continue
            taken.add(i)
            used.add(j)
            track = tracks[j]
            if track is None:
                mine = seen[i]
            else:
                track.update(seen[i])
        return mine, [one for i, one in enumerate(seen) if i not in taken]

    def _cost(self, person: Estimate, seen: Measurement, gate: float) -> float:
        """Return the cost of a measurement being the person's; infinite outside the gate."""
        (pxx, pxy, _), (_, pyy, _), _ = person.covariance
        (rxx, rxy, _), (_, ryy, _), _ = seen.covariance
        xx, xy, yy = pxx + rxx, pxy + rxy, pyy + ryy
        determinant = xx * yy - xy * xy
        dx, dy = seen.pose.x - person.pose.x, seen.pose.y - person.pose.y
        distance = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant
        if distance >= gate:
            return math.inf
        return distance + math.log(determinant) - hint(self._identity, seen)

    def _accept(self, time: float, person: Estimate, seen: Measurement) -> tuple[Measurement, bool]:
        """Return a measurement in the gate, turned by 180° if it shows the person backwards."""
        self._hits += 1
        self._last = seen.pose
        self._identity = seen.identity or self._identity
        if not has_heading(seen):
            return seen, False  # it neither contradicts nor confirms the heading
        variance = person.covariance[2][2] + seen.covariance[2][2]
        if not is_flipped(wrap(seen.pose.yaw - person.pose.yaw), variance):
            self._flipped = Contradiction()
            return seen, False
        if forward_speed(person) < WALKING_M_S:  # people walk forwards: else the sensor is wrong
            self._flipped = self._flipped.again(time)
        if self._flipped.lasts(time):
            return self._restart(seen)
        turned = seen.pose._replace(yaw=wrap(seen.pose.yaw + math.pi))
        return seen._replace(pose=turned), False

    def _restart(self, seen: Measurement) -> tuple[Measurement, bool]:
        """Return a measurement that restarts the person's track."""
        self._forget_person()
        self._others = [other for other in self._others if other.cost(seen) == math.inf]
        self._identity = seen.identity
        self._last = seen.pose
        self._hits = 1
        return seen, True


def hint(identity: str, seen: Measurement) -> float:
    """Return the bonus of a measurement's identity, given the identity of a track."""
    return SAME_ID if identity and seen.identity == identity else 0.0


class Contradiction(NamedTuple):
    """Frames in a row that contradict the person's track."""

    since: float = 0.0
    frames: int = 0

    def again(self, time: float) -> Contradiction:
        """Return the sequence with one more frame, captured at `time` [s]."""
        return Contradiction(self.since if self.frames else time, self.frames + 1)

    def lasts(self, time: float) -> bool:
        """Return whether the sequence is too long to be chance at `time` [s]."""
        return self.frames >= CONFIRMED and time - self.since >= DOUBT_S


def forward_speed(person: Estimate) -> float:
    """Return the speed along the heading [m/s]."""
    yaw, velocity = person.pose.yaw, person.velocity
    return velocity.x * math.cos(yaw) + velocity.y * math.sin(yaw)


def is_flipped(innovation: float, variance: float) -> bool:
    """Return whether a flipped heading is likelier than an error of the size of `innovation`.

    Args:
        innovation: Observed less predicted heading, wrapped [rad].
        variance: Variance of the innovation if the heading is not flipped [rad²].
    """
    gain = innovation**2 - wrap(innovation + math.pi) ** 2
    return gain > 2.0 * variance * math.log((1.0 - FLIP_PROBABILITY) / FLIP_PROBABILITY)


def nearest(seen: Sequence[Measurement], pose: Pose2D) -> Measurement:
    """Return the measurement that is the nearest to a pose."""
    return min(seen, key=lambda one: one.pose.distance(pose))


def from_line(pose: Pose2D, begin: Pose2D, end: Pose2D) -> float:
    """Return the distance of a pose from the line segment between two others [m]."""
    x, y = end.x - begin.x, end.y - begin.y
    along = (pose.x - begin.x) * x + (pose.y - begin.y) * y
    share = min(max(along / max(x * x + y * y, 1e-9), 0.0), 1.0)
    return math.hypot(pose.x - begin.x - share * x, pose.y - begin.y - share * y)


def spread(covariance: PlanarCovariance) -> float:
    """Return the mean variance of x and y [m²]."""
    return (covariance[0][0] + covariance[1][1]) / 2.0
