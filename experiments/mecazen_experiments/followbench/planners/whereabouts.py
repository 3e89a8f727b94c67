"""Where the target is and will be, seen or unseen."""

from __future__ import annotations

import math

import numpy as np
from mecazen.portable import Floats, arctan2
from mecazen_people.manners.walking import STEP_S

from mecazen_experiments.followbench.sight import ANGLES, APART
from mecazen_experiments.followbench.unicycle import PERSON_RADIUS
from mecazen_experiments.followbench.view import Seen, View

SMOOTH_S, DRIFT_S, PACE_S = 0.5, 1.5, 3.0
"""Time constants of the velocity, of the drift's direction and of its speed [s]; a target that
gives way zigzags."""
DRIFTS_S = 1.0
"""Time after which a guess follows the drift instead of the velocity [s]."""
WALKING_M_S = 0.3
"""Below this smoothed speed, the target keeps the heading of before."""
SURE_M = 4.5
"""A target nearer than this in the open would be seen."""
REACHED_M = 1.2
"""The robot has come to a place within this distance [m]."""
APART_M, LONGEST = 0.3, 40
"""Distance between the places of the trail [m], and their number."""
GUESSES = [
    (speed, turn)
    for turns in ((0.0,), (0.35, -0.35), (0.8, -0.8), (1.5, -1.5))
    for speed in (1.0, 0.7, 0.4)
    for turn in turns
] + [(0.0, 0.0)]
"""Share of the last speed and change of direction [rad] of an unseen target, likeliest first."""


class Whereabouts:
    """The target's motion: measured while it is visible, guessed while it is not.

    A guess is dropped when the robot looks where the target should be, and sees no one.
    """

    def __init__(self) -> None:
        self.last: Seen | None = None
        """The target when it was last visible."""
        self.heading = 0.0
        """Direction of its walk [rad]."""
        self.unseen_s = 0.0
        self.trail: list[tuple[float, float]] = []
        """Places of the target that the robot has not come to, the oldest first [m]."""
        self._velocity: Floats = np.zeros(2)
        self._drift: Floats = np.zeros(2)
        self._pace = 0.0
        self._left = list(range(len(GUESSES)))

    def update(self, view: View) -> None:
        """Take what the robot sees in a step."""
        for number in reversed(range(len(self.trail))):
            if math.dist(self.trail[number], view.robot[:2]) < REACHED_M:
                del self.trail[: number + 1]
                break
        if view.target is None:
            self.unseen_s += STEP_S
            self._drop(view)
            return
        velocity = np.array(view.target[2:])
        pace = math.hypot(*velocity.tolist())
        if self.last is None:
            self._velocity = self._drift = velocity
            self._pace = pace
        self._velocity = self._velocity + STEP_S / SMOOTH_S * (velocity - self._velocity)
        self._drift = self._drift + STEP_S / DRIFT_S * (velocity - self._drift)
        self._pace += STEP_S / PACE_S * (pace - self._pace)
        self.last, self.unseen_s = view.target, 0.0
        self.restart()
        place = view.target[:2]
        if not self.trail or math.dist(place, self.trail[-1]) > APART_M:
            self.trail = [*self.trail[-LONGEST + 1 :], place]
        vx, vy = self._velocity.tolist()
        if math.hypot(vx, vy) > WALKING_M_S:
            self.heading = math.atan2(vy, vx)

    def ahead(self, times: Floats, guess: int = 0) -> Floats:
        """Return where the target will be some times from now [s]: (times, 2) [m].

        Args:
            times: The times [s].
            guess: The number of the guess among those that are left, if it is unseen.
        """
        return self._walked(times + self.unseen_s, *GUESSES[self._left[guess]])

    def guesses(self) -> Floats:
        """Return where the target may be (n, 2) [m], the likeliest place first."""
        speed, turn = np.array([GUESSES[number] for number in self._left]).T
        return self._walked(np.full(len(speed), self.unseen_s), speed, turn)

    def restart(self) -> None:
        """Take back all guesses."""
        self._left = list(range(len(GUESSES)))

    def _walked(self, when: Floats, speed: Floats | float, turn: Floats | float) -> Floats:
        """Return places some times after the last sight: (times, 2) [m]."""
        assert self.last is not None
        first, later = np.minimum(when, DRIFTS_S), np.maximum(when - DRIFTS_S, 0.0)
        (vx, vy), (drift_x, drift_y) = self._velocity.tolist(), self._drift.tolist()
        scale = self._pace / max(math.hypot(drift_x, drift_y), 1e-9)
        x, y = first * vx + later * scale * drift_x, first * vy + later * scale * drift_y
        c, s = speed * np.cos(turn), speed * np.sin(turn)
        return np.stack((self.last.x + c * x - s * y, self.last.y + s * x + c * y), axis=1)

    def _drop(self, view: View) -> None:
        """Drop guesses at places that the robot sees; start again when none is left."""
        if self.last is None:
            return
        dx, dy = (self.guesses() - np.array(view.robot[:2])).T
        distance = np.sqrt(dx * dx + dy * dy)
        from_first = (arctan2(dy, dx) - view.robot.yaw - ANGLES[0]) % math.tau
        beam = np.rint(from_first / APART).astype(int)
        seen = (distance < SURE_M) & (view.ranges[beam] > distance - PERSON_RADIUS)
        self._left = [one for one, is_seen in zip(self._left, seen, strict=True) if not is_seen]
        if not self._left:
            self.restart()
