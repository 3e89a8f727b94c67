"""Driving by hand: held keys and sticks to a velocity, without terminal, bus and clock.

Most terminals do not report releases. For a held key they report the press, the first repeat after
about half a second, and then some tens of repeats a second. Only the key that was pressed last
repeats. A key therefore counts as held until its next repeat is overdue. Terminals with kitty's
keyboard protocol report releases; there several keys can be held at once.
"""

from __future__ import annotations

import math

from mecazen.geometry import Twist2D

FIRST_S = 0.7
"""Maximum time from a press to the first repeat [s]: 0.66 s in X, 0.5 s on most desktops."""
REPEAT_S = 0.25
"""Maximum time between two repeats [s]: 0.04 s, and the delay of a network."""
SILENCE_S = 2.0
"""If releases are reported, keys count as released after this silence [s]: the line may be cut."""

_AHEAD, _BACK = Twist2D(x=1.0), Twist2D(x=-1.0)
_LEFT, _RIGHT = Twist2D(y=1.0), Twist2D(y=-1.0)
DIRECTIONS = {
    **dict.fromkeys(("w", "up"), _AHEAD),
    **dict.fromkeys(("s", "down"), _BACK),
    "a": _LEFT,
    "d": _RIGHT,
    **dict.fromkeys(("j", "left"), Twist2D(yaw=1.0)),
    **dict.fromkeys(("l", "right"), Twist2D(yaw=-1.0)),
    # curves, for terminals that report one key at a time
    "u": Twist2D(x=1.0, yaw=1.0),
    "o": Twist2D(x=1.0, yaw=-1.0),
}
"""Direction of each key, as shares of the speeds."""
SLOWER, FASTER = -10, 10
SPEEDS = {**dict.fromkeys("-_", SLOWER), **dict.fromkeys("+=", FASTER)}
"""Change of the speeds by each key [%]."""
LEAST_PERCENT, MOST_PERCENT = 10, 300
STOP = "space"
HELP = "w a s d or ↑ ↓ move · ← → or j l turn · u o curve · + - speed · space stops · q ends"

DEAD_ZONE = 0.15
"""Maximum deflection of a released stick, as a share of its full deflection."""


class Hand:
    """The velocity commanded by hand.

    Args:
        speed_m_s: Speed along the ground at 100 % [m/s].
        turn_rad_s: Yaw rate at 100 % [rad/s].
        tells_release: Whether the terminal reports the release of a key.
    """

    def __init__(self, speed_m_s: float, turn_rad_s: float, *, tells_release: bool) -> None:
        self.percent = 100
        self._speed = speed_m_s
        self._turn = turn_rad_s
        self._tells_release = tells_release
        self._held: dict[str, float] = {}
        """Time until which each key counts as held [s]."""

    def press(self, key: str, now_s: float, *, repeated: bool = False) -> None:
        """Process a press or repeat of a key; keys outside the tables have no effect."""
        if key == STOP:
            self._held = {}
        elif key in SPEEDS:
            self.percent = min(max(self.percent + SPEEDS[key], LEAST_PERCENT), MOST_PERCENT)
        elif key in DIRECTIONS:
            self._drop_overdue(now_s)
            if not self._tells_release:
                lasts_s = REPEAT_S if key in self._held else FIRST_S
                self._held = {key: now_s + lasts_s}
            elif not repeated or key in self._held:
                # only the newest key repeats: while it does, the others are held as well
                self._held = dict.fromkeys((*self._held, key), now_s + SILENCE_S)

    def release(self, key: str) -> None:
        """Process the release of a key."""
        self._held.pop(key, None)

    def command(self, now_s: float, stick: Twist2D | None = None) -> Twist2D:
        """Return the commanded velocity [m/s, m/s, rad/s].

        Args:
            now_s: The time on the clock of `press` [s].
            stick: Contribution of a gamepad, as shares of the speeds.
        """
        self._drop_overdue(now_s)
        parts = [DIRECTIONS[key] for key in self._held] + ([stick] if stick else [])
        x, y, yaw = (math.fsum(axis) for axis in zip(Twist2D(), *parts, strict=True))
        # diagonal motion is no faster than straight motion
        speed = self._speed * self.percent / 100 / max(math.hypot(x, y), 1.0)
        turn = self._turn * self.percent / 100 / max(abs(yaw), 1.0)
        return Twist2D(x * speed, y * speed, yaw * turn)

    def _drop_overdue(self, now_s: float) -> None:
        self._held = {key: until for key, until in self._held.items() if until > now_s}


def stick_twist(left_x: float, left_y: float, right_x: float) -> Twist2D:
    """Return the velocity of a gamepad's sticks, as shares of the speeds.

    Each deflection is from -1 to 1, positive to the right or towards the hand. The left stick
    moves, the right one turns.
    """
    return Twist2D(x=-_share(left_y), y=-_share(left_x), yaw=-_share(right_x))


def _share(deflection: float) -> float:
    """Return a stick's deflection without its dead zone."""
    beyond = max(abs(deflection) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
    return math.copysign(min(beyond, 1.0), deflection) if beyond else 0.0
