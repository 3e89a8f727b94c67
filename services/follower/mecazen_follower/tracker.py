"""The tracked person: from frames of the sensor to an estimate at the present time."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum

from mecazen.config import FollowerConfig
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import PlanarCovariance

from mecazen_follower.association import Association, nearest
from mecazen_follower.estimators import Estimate, make_estimator
from mecazen_follower.estimators.base import as_tuple
from mecazen_follower.measurement import Frame, Measurement
from mecazen_follower.sight import Sight

MISSED_FRAMES = 1.5
"""Number of sensor periods without an observation after which a frame counts as missed."""

COAST_S = 0.1
"""Time without an observation after which the person is not seen, for a fast sensor [s]."""

FRAMES = 25
"""Number of newest frames whose greatest latency is the estimator's delay."""
ROUNDING_S = 1e-6
"""Differences of latencies below this are rounding [s]."""

BIAS_STD = {
    "body": (0.018, math.radians(5.4)),
    "fused": (0.018, math.radians(5.4)),
    "legs": (0.05, 0.0),
}
"""Errors of position [m] and heading [rad] that all frames share, by kind of sensor, so that no
filter averages them out. For a camera they are the tracker's bias over the view (0.011 m of the
trunk's joints, 3.6° of the lines through hips and shoulders) and the body's sway and twist of
`perception`. For legs it is their offset behind the person's position, due to gait."""

GUESS_RAD = math.radians(45.0)
"""Standard deviation of a heading that is not observed."""
MEMORY_S = 5.0
"""Time constant of the mean [s]."""
LONGEST_FRAME_S = 0.1
"""Longest frame period [s]: over a longer period the person's acceleration exceeds the noise."""
NAMELESS_S = 2.0
"""Time without the person after which legs alone are not the person [s]."""
DOUBTED, MAX_RATIO = 1.5, 9.0
"""Ratios of variances: a ratio below `DOUBTED` may be chance; `MAX_RATIO` is the upper bound."""


class TrackingState(StrEnum):
    """How well the follower knows the person's position."""

    WAITING = "waiting"
    """Not seen yet; the robot stands."""
    FOLLOWING = "following"
    """Seen."""
    COASTING = "coasting"
    """Not seen at the moment; the robot follows the prediction."""
    SEARCHING = "searching"
    """Not seen for too long; the robot looks for the person."""
    LOST = "lost"
    """Not seen for too long; the robot stops."""


class ReportedNoise:
    """The sensor's actual variances relative to those that it reports, of position and yaw.

    The second difference of three frames z, z' - 2 z + z'', contains almost none of the person's
    motion and has six times the variance of white noise. No model of motion is needed, so a
    manoeuvre is not taken for noise. A sensor that is better than it reports does no harm.
    """

    def __init__(self) -> None:
        self._ratios = 1.0, 1.0
        self._frames: deque[tuple[float, Pose2D]] = deque(maxlen=3)
        """Times [s] and poses of the last frames of one track, none far from the next."""

    def interrupt(self) -> None:
        """Keep the ratios, but compare no frame before with any after: a new track begins."""
        self._frames.clear()

    def learn(self, time: float, pose: Pose2D, covariance: PlanarCovariance) -> None:
        """Learn from a measurement captured at `time` [s], with its `corrected` covariance."""
        if self._frames and time - self._frames[-1][0] > LONGEST_FRAME_S:
            self.interrupt()
        self._frames.append((time, pose))
        if len(self._frames) < 3:
            return
        (begin, first), (middle, second), (end, third) = self._frames
        dt = end - middle
        if not math.isclose(middle - begin, dt, rel_tol=0.01):
            return
        steps = zip(_step(first, second), _step(second, third), strict=True)
        xx, yy, ww = ((after - before) ** 2 / 6.0 for before, after in steps)
        (rxx, _, _), (_, ryy, _), (_, _, rww) = covariance
        weight = -math.expm1(-dt / MEMORY_S)
        ratios = (xx + yy) / (rxx + ryy), ww / rww
        position, heading = (
            min(old + weight * (applied * new - old), MAX_RATIO)
            for old, applied, new in zip(self._ratios, self._applied, ratios, strict=True)
        )
        self._ratios = position, heading

    @property
    def _applied(self) -> tuple[float, float]:
        position, heading = (ratio if ratio > DOUBTED else 1.0 for ratio in self._ratios)
        return position, heading

    def correct(self, measurement: Measurement) -> Measurement:
        """Return a measurement with its covariance `corrected`."""
        return measurement._replace(covariance=self.corrected(measurement.covariance))

    def corrected(self, covariance: PlanarCovariance) -> PlanarCovariance:
        """Return a reported covariance, scaled up if the sensor is noisier than it reports."""
        position, heading = self._applied
        if position == heading == 1.0:
            return covariance
        both = math.sqrt(position * heading)
        (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
        return (
            (xx * position, xy * position, xw * both),
            (yx * position, yy * position, yw * both),
            (wx * both, wy * both, ww * heading),
        )


class PersonTracker:
    """Estimates the person from frames that show any people in any order, and that arrive late.

    The estimator's time is that of the captures: it is behind the present by the greatest latency
    of the last frames, which their stamps show. The returned estimate is propagated by this delay.

    Args:
        config: The follower's configuration.
        sensor: The sensor by which the person is found.
        hold: Time for which a frame is held back, so that frames of several sensors are used in
            the order of their captures [s].
    """

    def __init__(self, config: FollowerConfig, sensor: Sight, hold: float = 0.0) -> None:
        self.estimator = make_estimator(config.estimator, config.estimator_params)
        # ticks between two frames of the sensor do not count as unseen
        missed = MISSED_FRAMES / sensor.rate_hz
        self.coast_after = max(COAST_S, missed)
        self._lost_after = max(config.lost_after_s, 2.0 * missed)
        self._bias = BIAS_STD.get(sensor.kind)
        self._association = Association(2.0 * self._lost_after)
        self._noise = ReportedNoise()
        self._latency = self._least_latency = sensor.latency_s
        self._latencies: deque[float] = deque(maxlen=FRAMES)
        self._captured = {True: -math.inf, False: -math.inf}
        """Capture time of the newest frame with a person [s], by `Frame.begins`."""
        self._hold = hold
        self.forget()

    def forget(self) -> None:
        """Discard the person and all frames, since they refer to another place."""
        self.state = TrackingState.WAITING
        self.unseen = 0.0
        """Time since the person was last seen [s]; 0 before that."""
        self._last_seen: float | None = None
        self._waiting: list[Frame] = []
        self._association.reset()
        self._end_track()

    def _end_track(self) -> None:
        self.estimator.reset()
        self._noise.interrupt()
        self._time: float | None = None
        """Time of the estimate [s]; None if there is none."""

    @property
    def strangers(self) -> list[tuple[float, float]]:
        """Positions of all who are known not to be the person [m]."""
        return self._association.strangers

    def begin_search(self) -> None:
        """Take no one who has appeared since the loss for another person."""
        if self._last_seen is not None:
            self._association.forget_since(self._last_seen)

    def add(self, frame: Frame) -> None:
        """Add a frame for the next step."""
        self._waiting.append(frame)

    def step(self, time: float, expected: Pose2D) -> Estimate | None:
        """Return the person at `time` [s], and update `state`; None before the first detection.

        `expected` is the person's pose if the robot were at its goal.
        """
        for due in self._due(time):
            if self._see(time, due, expected):
                self._last_seen = time
        self._update_state(time)
        if self._time is None:
            return None
        self._predict(time - self._latency)
        person = self.estimator.ahead(max(time - self._time, 0.0))
        return person if person is None or self._bias is None else _biased(person, *self._bias)

    def _update_state(self, time: float) -> None:
        if self._last_seen is None:
            return
        self.unseen = time - self._last_seen
        if self.unseen > self._lost_after:
            self.state = TrackingState.LOST
        elif self.unseen > self.coast_after:
            self.state = TrackingState.COASTING
        else:
            self.state = TrackingState.FOLLOWING

    def _due(self, time: float) -> list[Frame]:
        """Remove and return the frames that are no longer held back, in order of capture."""
        until = time - self._hold + 1e-9
        due = [frame for frame in self._waiting if frame.captured <= until]
        if due:
            self._waiting = [frame for frame in self._waiting if frame.captured > until]
            due.sort(key=lambda frame: (frame.captured, not frame.begins))
        return due

    def _see(self, time: float, frame: Frame, expected: Pose2D) -> bool:
        """Correct the estimate; return whether the frame shows the person."""
        captured, measurements, begins = frame
        lost = self.state is TrackingState.LOST
        is_late = captured <= self._captured[begins] or captured < self._captured[not begins]
        if not measurements or is_late or (not begins and self._time is None):
            return False
        self._captured[begins] = captured
        if not begins and self.unseen > NAMELESS_S:
            self._association.watch(frame)
            return False
        self._latencies.append(time - captured)
        latency = max(self._least_latency, *self._latencies)
        if not -ROUNDING_S <= latency - self._latency <= 0.0:
            self._latency = latency
        person = None
        if self._time is not None:
            self._predict(captured)
            person = self.estimator.estimate
        known = [
            measurement._replace(covariance=as_tuple(self.estimator.noise(measurement.covariance)))
            for measurement in measurements
        ]
        if not self.estimator.predicts:
            pose, covariance, _ = nearest(known, expected if person is None else person.pose)
        else:
            known = [
                self._noise.correct(_headed(measurement, person, expected)) for measurement in known
            ]
            choice = self._association.choose(
                frame._replace(measurements=known),
                person,
                expected,
                unseen=self.unseen,
                lost=lost,
            )
            if choice is None:
                return False
            (pose, covariance, _), restart = choice
            if restart:
                self._end_track()
            if begins:
                self._noise.learn(captured, pose, covariance)
        self.estimator.update(pose, covariance)
        if self._time is None:
            self._time = captured
        return True

    def _predict(self, time: float) -> None:
        """Propagate the estimate to `time` [s], unless its time is later."""
        if self._time is not None and time > self._time:
            self.estimator.predict(time - self._time)
            self._time = time


def _step(begin: Pose2D, end: Pose2D) -> Pose2D:
    return Pose2D(end.x - begin.x, end.y - begin.y, wrap(end.yaw - begin.yaw))


def _biased(person: Estimate, place_std: float, yaw_std: float) -> Estimate:
    """Return an estimate whose covariance includes the full variance of a bias.

    The filter does not estimate the bias: it is a consider parameter, with the gain at its limit of
    1. S. F. Schmidt, Application of state-space methods to navigation problems, 1966.
    """
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = person.covariance
    place, yaw = place_std * place_std, yaw_std * yaw_std
    covariance = (xx + place, xy, xw), (yx, yy + place, yw), (wx, wy, ww + yaw)
    return person._replace(covariance=covariance)


def _headed(measurement: Measurement, person: Estimate | None, expected: Pose2D) -> Measurement:
    """Fill in the heading of a measurement without one from the estimate.

    Before the person is known, the heading is that of `expected`, with the deviation `GUESS_RAD`.
    """
    if measurement.has_heading:
        return measurement
    if person is not None:
        return measurement._replace(pose=measurement.pose._replace(yaw=person.pose.yaw))
    guess = measurement.pose._replace(yaw=expected.yaw)
    (xx, xy, _), (yx, yy, _), _ = measurement.covariance
    covariance = (xx, xy, 0.0), (yx, yy, 0.0), (0.0, 0.0, GUESS_RAD**2)
    return measurement._replace(pose=guess, covariance=covariance)
