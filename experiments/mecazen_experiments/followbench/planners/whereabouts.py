"""The target's present and future positions, seen or unseen."""

from __future__ import annotations

import math

import numpy as np
from mecazen.portable import Floats, arctan2

from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.sight import ANGLES, APART
from mecazen_experiments.followbench.unicycle import PERSON_RADIUS
from mecazen_experiments.followbench.view import Seen, View

SMOOTH_S, DRIFT_S, PACE_S = 0.5, 1.5, 3.0
"""Time constants of the velocity, of the drift's direction and of the drift's speed [s]. The drift
averages over the zigzag of a target that avoids others."""
DRIFTS_S = 1.0
"""Time after which a guess follows the drift instead of the velocity [s]."""
WALKING_M_S = 0.3
"""Below this smoothed speed, the target keeps the previous heading."""
SURE_M = 4.5
"""Distance within which a target would be seen, without obstacles in between [m]."""
REACHED_M = 1.2
"""Distance at which the robot has reached a point [m]."""
APART_M, LONGEST = 0.3, 40
"""Distance between the points of the trail [m], and their maximum number."""
GUESSES = [
    (speed, turn)
    for turns in ((0.0,), (0.35, -0.35), (0.8, -0.8), (1.5, -1.5))
    for speed in (1.0, 0.7, 0.4)
    for turn in turns
] + [(0.0, 0.0)]
"""Share of the last speed and change of direction [rad] of an unseen target, likeliest first."""


class Whereabouts:
    """The target's motion: measured while the target is visible, guessed while it is not.

    A guess is dropped when the robot sees its position, but no target.
    """

    def __init__(self) -> None:
        self.last: Seen | None = None
        """The target when it was last visible."""
        self.heading = 0.0
        """Walking direction of the target [rad]."""
        self.unseen_s = 0.0
        self.trail: list[tuple[float, float]] = []
        """Positions of the target that the robot has not reached yet, the oldest first [m]."""
        self._velocity: Floats = np.zeros(2)
        self._drift: Floats = np.zeros(2)
        self._pace = 0.0
        self._left = list(range(len(GUESSES)))

    def update(self, view: View) -> None:
        """Update with the robot's view in a step."""
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
        """Return the predicted positions of the target (times, 2) [m].

        Args:
            times: Times from now [s].
            guess: Number of the guess among the remaining ones, if the target is unseen.
        """
        return self._walked(times + self.unseen_s, *GUESSES[self._left[guess]])

    def guesses(self) -> Floats:
        """Return the guessed positions of the target (n, 2) [m], the likeliest first."""
        speed, turn = np.array([GUESSES[number] for number in self._left]).T
        return self._walked(np.full(len(speed), self.unseen_s), speed, turn)

    def restart(self) -> None:
        """Restore all guesses."""
        self._left = list(range(len(GUESSES)))

    def _walked(self, when: Floats, speed: Floats | float, turn: Floats | float) -> Floats:
        """Return positions at times `when` after the last sight: (times, 2) [m]."""
        assert self.last is not None
        first, later = np.minimum(when, DRIFTS_S), np.maximum(when - DRIFTS_S, 0.0)
        (vx, vy), (drift_x, drift_y) = self._velocity.tolist(), self._drift.tolist()
        scale = self._pace / max(math.hypot(drift_x, drift_y), 1e-9)
        x, y = first * vx + later * scale * drift_x, first * vy + later * scale * drift_y
        c, s = speed * np.cos(turn), speed * np.sin(turn)
        return np.stack((self.last.x + c * x - s * y, self.last.y + s * x + c * y), axis=1)

    def _drop(self, view: View) -> None:
        """Drop guesses at positions that the robot sees; restore all when none is left."""
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
