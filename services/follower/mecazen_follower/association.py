"""Data association: which detection is the person, by a gate, the likeliest track, and doubt.

People walk and do not jump. So a detection outside the gate of the person's track is another
person, who gets a separate track and is not mistaken for the person later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mecazen.geometry import Pose2D, wrap
from mecazen.messages import PlanarCovariance
from mecazen.walkers import WalkerTrack

from mecazen_follower.estimators import Estimate
from mecazen_follower.measurement import Frame, Measurement

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
CROWD = 30
"""Maximum number of detections per frame, nearest first; the work grows with its square."""
FLIP_PROBABILITY = 0.03
"""Probability that a tracker confuses front and back."""


class OtherTrack:
    """The track of another person or thing: a walker, or something that stands."""

    def __init__(self, time: float, seen: Measurement) -> None:
        self._walker = WalkerTrack.begin(time, seen.pose[:2], spread(seen.covariance))
        self._identity = seen.identity
        self.begin = time
        """Time of the first detection [s]."""
        self._place = time, seen.pose[:2]
        """Time since which the track is near a place, and that place."""

    @property
    def place(self) -> tuple[float, float]:
        """The position [m]."""
        return self._walker.x, self._walker.y

    @property
    def stands(self) -> bool:
        """Whether the track has been near a place for `STANDING_S`."""
        return self._walker.seen[0] - self._place[0] >= STANDING_S

    @property
    def is_old(self) -> bool:
        """Whether the track has not been seen for too long."""
        unseen = self._walker.time - self._walker.seen[0]
        return unseen > (HIDDEN_S if self.stands else FORGET_S)

    def predict(self, time: float) -> None:
        """Propagate to a time [s]."""
        walker = self._walker
        self._walker = walker._replace(time=time) if self.stands else walker.predicted(time)

    def claims(self, seen: Measurement) -> bool:
        """Return whether a detection is where this track stands."""
        return self.stands and math.dist(self.place, seen.pose[:2]) <= STILL_M

    def cost(self, seen: Measurement) -> float:
        """Return the cost of assigning a detection to this track; infinite outside the gate."""
        variance = self._walker.variances[0] + spread(seen.covariance)
        dx, dy = seen.pose.x - self._walker.x, seen.pose.y - self._walker.y
        distance = (dx * dx + dy * dy) / variance
        if distance >= GATE:
            return math.inf
        bonus = SAME_ID if seen.has_id(self._identity) else 0.0
        return distance + 2.0 * math.log(variance) - bonus

    def update(self, seen: Measurement) -> None:
        walker, (x, y, _) = self._walker, seen.pose
        if self.stands:  # only the side that the robot sees changes
            self._walker = walker._replace(
                x=walker.x + STANDING_GAIN * (x - walker.x),
                y=walker.y + STANDING_GAIN * (y - walker.y),
                vx=0.0,
                vy=0.0,
                seen=(walker.time, x, y),
            )
        else:
            self._walker = walker.corrected((x, y), spread(seen.covariance))
        self._identity = seen.identity or self._identity
        if math.dist(self._place[1], self.place) > STILL_M:
            self._place = self._walker.time, self.place


class Association:
    """Chooses the person's measurement of every frame.

    After `patience` [s] without the person, the nearest detection becomes the person.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self.reset()

    def reset(self) -> None:
        self._others: list[OtherTrack] = []
        self._forget_person()

    def _forget_person(self) -> None:
        self._identity = ""
        self._last = Pose2D()
        self._hits = 0
        self._contradicted: list[float] = []
        """Times of the last frames in a row that show the person elsewhere [s]."""
        self._flipped: list[float] = []
        """Times of the last frames in a row that show the person backwards [s]."""

    def choose(
        self,
        frame: Frame,
        person: Estimate | None,
        expected: Pose2D,
        *,
        unseen: float,
        lost: bool,
    ) -> tuple[Measurement, bool] | None:
        """Return the person's measurement, and whether it restarts their track.

        A restart replaces a track that is wrong or too old. None if no measurement of the frame is
        the person's.

        Args:
            frame: The frame, in which every measurement has a known covariance.
            person: The person's estimate at its capture; None if the person was never seen.
            expected: The person's pose if the robot were at its goal: without an estimate, the
                measurement nearest to this pose is the person's.
            unseen: Time since the person was last seen [s].
            lost: Whether `unseen` is too long for a useful estimate.
        """
        time, seen, begins = frame
        self._predict(time)
        if len(seen) > CROWD:
            place = expected if person is None else person.pose
            seen = sorted(seen, key=lambda measurement: measurement.pose.distance(place))[:CROWD]
        if person is None:
            return self._restart(nearest(seen, expected))
        if unseen > self._patience:
            return self._restart(nearest(seen, person.pose))
        mine, free = self._assign(seen, person, GATE if begins else NAMELESS_GATE)
        last = self._last if unseen > DOUBT_S else person.pose
        # a person out of sight may have stopped anywhere on the predicted path
        far = [
            detection
            for detection in free
            if from_line(detection.pose, last, person.pose) >= APART_M
        ]
        if mine is not None:
            self._add(time, far)
            if begins:
                self._contradicted.clear()
            return self._accept(time, person, mine)
        if not free:
            return None  # all are known to be other people
        named = [detection for detection in free if detection.has_id(self._identity)]
        candidate = nearest(named or free, person.pose)
        near = bool(named) or from_line(candidate.pose, last, person.pose) < APART_M
        if begins:
            self._contradicted.append(time)
            stays = near and lasts(self._contradicted, time)
            if lost or self._hits < CONFIRMED or stays:
                return self._restart(candidate)
        self._add(time, far)
        return None

    def forget_since(self, time: float) -> None:
        """Forget all who have appeared since a time [s]: any of them may be the person."""
        self._others = [track for track in self._others if track.begin <= time]

    def watch(self, frame: Frame) -> None:
        """Follow the other people while the person is lost."""
        self._predict(frame.captured)
        self._assign(frame.measurements)

    @property
    def strangers(self) -> list[tuple[float, float]]:
        """Positions of the other people [m]."""
        return [track.place for track in self._others]

    def _predict(self, time: float) -> None:
        for track in self._others:
            track.predict(time)
        self._others = [track for track in self._others if not track.is_old]

    def _add(self, time: float, seen: Sequence[Measurement]) -> None:
        self._others = [*self._others, *(OtherTrack(time, detection) for detection in seen)][
            -CROWD:
        ]

    def _assign(
        self, seen: Sequence[Measurement], person: Estimate | None = None, gate: float = GATE
    ) -> tuple[Measurement | None, list[Measurement]]:
        """Return the person's measurement and those without a known track; update other tracks.

        Pairs of track and measurement are taken in the order of their likelihood, those with
        standing tracks first: a thing in front of a hidden person is not that person.
        """
        tracks = [*self._others] if person is None else [None, *self._others]
        named = any(detection.has_id(self._identity) for detection in seen)
        pairs = []
        for i, detection in enumerate(seen):
            for j, track in enumerate(tracks):
                if track is None and named and not detection.has_id(self._identity):
                    continue  # a sensor does not see a person twice
                cost = math.inf
                if track is not None:
                    cost = track.cost(detection)
                elif person is not None:
                    cost = self._cost(person, detection, gate)
                if cost < math.inf:
                    pairs.append((track is None or not track.claims(detection), cost, i, j))
        mine, assigned, used = None, set[int](), set[int]()
        for _, _, i, j in sorted(pairs):
            if i in assigned or j in used:
                continue
            assigned.add(i)
            used.add(j)
            track = tracks[j]
            if track is None:
                mine = seen[i]
            else:
                track.update(seen[i])
        return mine, [detection for i, detection in enumerate(seen) if i not in assigned]

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
        bonus = SAME_ID if seen.has_id(self._identity) else 0.0
        return distance + math.log(determinant) - bonus

    def _accept(self, time: float, person: Estimate, seen: Measurement) -> tuple[Measurement, bool]:
        """Return a measurement in the gate, turned by 180° if it shows the person backwards."""
        self._hits += 1
        self._last = seen.pose
        self._identity = seen.identity or self._identity
        if not seen.has_heading:
            return seen, False  # it neither contradicts nor confirms the heading
        variance = person.covariance[2][2] + seen.covariance[2][2]
        if not is_flipped(wrap(seen.pose.yaw - person.pose.yaw), variance):
            self._flipped.clear()
            return seen, False
        if forward_speed(person) < WALKING_M_S:  # people walk forwards: else the sensor is wrong
            self._flipped.append(time)
        if lasts(self._flipped, time):
            return self._restart(seen)
        turned = seen.pose._replace(yaw=wrap(seen.pose.yaw + math.pi))
        return seen._replace(pose=turned), False

    def _restart(self, seen: Measurement) -> tuple[Measurement, bool]:
        """Return a measurement that restarts the person's track."""
        self._forget_person()
        self._others = [track for track in self._others if track.cost(seen) == math.inf]
        self._identity = seen.identity
        self._last = seen.pose
        self._hits = 1
        return seen, True


def lasts(frames: Sequence[float], time: float) -> bool:
    """Return whether frames in a row, captured at these times [s], are no chance at `time` [s]."""
    return len(frames) >= CONFIRMED and time - frames[0] >= DOUBT_S


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
    return min(seen, key=lambda measurement: measurement.pose.distance(pose))


def from_line(pose: Pose2D, begin: Pose2D, end: Pose2D) -> float:
    """Return the distance of a pose from the line segment between two others [m]."""
    x, y = end.x - begin.x, end.y - begin.y
    along = (pose.x - begin.x) * x + (pose.y - begin.y) * y
    share = min(max(along / max(x * x + y * y, 1e-9), 0.0), 1.0)
    return math.hypot(pose.x - begin.x - share * x, pose.y - begin.y - share * y)


def spread(covariance: PlanarCovariance) -> float:
    """Return the mean variance of x and y [m²]."""
    return (covariance[0][0] + covariance[1][1]) / 2.0
