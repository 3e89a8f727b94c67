"""Where the target is and will be, seen or unseen."""

from __future__ import annotations

import math

import numpy as np
from mecazen.portable import Floats, arctan2

from mecazen_experiments.followbench.planners.chase import STEP_S
from mecazen_experiments.followbench.view import Seen, View

SMOOTH_S = 1.0
"""Time constant of the smoothed velocity [s]: a target that gives way to others zigzags."""
WALKING_M_S = 0.3
"""Below this smoothed speed, the target keeps the heading of before."""
SURE_M = 4.5
"""A target nearer than this in the open would be seen."""
RADIUS_M = 0.3
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
        self._velocity = (0.0, 0.0)
        self._left = list(range(len(GUESSES)))

    def update(self, view: View) -> None:
        """Take what the robot sees in a step."""
        if view.target is None:
            self.unseen_s += STEP_S
            self._drop(view)
            return
        share = STEP_S / SMOOTH_S if self.last is not None else 1.0
        vx, vy = self._velocity
        vx, vy = vx + share * (view.target.vx - vx), vy + share * (view.target.vy - vy)
        self.last, self._velocity, self.unseen_s = view.target, (vx, vy), 0.0
        self._left = list(range(len(GUESSES)))
        if math.hypot(vx, vy) > WALKING_M_S:
            self.heading = math.atan2(vy, vx)

    def ahead(self, times: Floats) -> Floats:
        """Return where the target will be some times from now [s]: (times, 2) [m]."""
        assert self.last is not None
        speed, turn = GUESSES[self._left[0]]
        c, s = speed * math.cos(turn), speed * math.sin(turn)
        vx, vy = self._velocity
        when = times + self.unseen_s
        x, y = self.last.x + when * (c * vx - s * vy), self.last.y + when * (s * vx + c * vy)
        return np.stack((x, y), axis=1)

    def _drop(self, view: View) -> None:
        """Drop guesses at places that the robot sees; start again when none is left."""
        if self.last is None:
            return
        speed, turn = np.array([GUESSES[number] for number in self._left]).T
        c, s = speed * np.cos(turn), speed * np.sin(turn)
        vx, vy = self._velocity
        dx = self.last.x + self.unseen_s * (c * vx - s * vy) - view.robot.x
        dy = self.last.y + self.unseen_s * (s * vx + c * vy) - view.robot.y
        distance = np.sqrt(dx * dx + dy * dy)
        number = len(view.ranges)
        beam = np.rint((arctan2(dy, dx) - view.robot.yaw) * (number / math.tau)).astype(int)
        seen = (distance < SURE_M) & (view.ranges[beam % number] > distance - RADIUS_M)
        self._left = [one for one, is_seen in zip(self._left, seen, strict=True) if not is_seen]
        if not self._left:
            self._left = list(range(len(GUESSES)))
