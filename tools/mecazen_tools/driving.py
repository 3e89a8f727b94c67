"""Driving by hand: what is held of keys and sticks, to a velocity. No terminal, no bus, no clock.

Most terminals tell no release. Of a key that is held they tell the press, after half a second or
so the first repeat, and then some tens a second, and only of the key that was pressed last. So a
key counts as held until its next repeat is overdue. Terminals with the keyboard protocol of kitty
tell releases; there several keys can be held at once.
"""

from __future__ import annotations

import math

from mecazen.geometry import Twist2D

FIRST_S = 0.7
"""From a press to the first repeat at most: X has 0.66 s, most desktops 0.5 s."""
REPEAT_S = 0.25
"""From one repeat to the next at most: 0.04 s, and what a network adds."""
SILENCE_S = 2.0
"""Where releases are told, keys are let go after so long without a word: the line may be cut."""

_AHEAD, _BACK = Twist2D(x=1.0), Twist2D(x=-1.0)
_LEFT, _RIGHT = Twist2D(y=1.0), Twist2D(y=-1.0)
DIRECTIONS = {
    **dict.fromkeys(("w", "up"), _AHEAD),
    **dict.fromkeys(("s", "down"), _BACK),
    "a": _LEFT,
    "d": _RIGHT,
    **dict.fromkeys(("j", "left"), Twist2D(yaw=1.0)),
    **dict.fromkeys(("l", "right"), Twist2D(yaw=-1.0)),
    # curves, for terminals that know one key at a time
    "u": Twist2D(x=1.0, yaw=1.0),
    "o": Twist2D(x=1.0, yaw=-1.0),
}
"""What each key means, as shares of the speeds."""
SLOWER, FASTER = -10, 10
SPEEDS = {**dict.fromkeys("-_", SLOWER), **dict.fromkeys("+=", FASTER)}
"""By how many percent each key changes the speeds."""
LEAST_PERCENT, MOST_PERCENT = 10, 300
STOP = "space"
HELP = "w a s d or ↑ ↓ move · ← → or j l turn · u o curve · + - speed · space stops · q ends"

DEAD_ZONE = 0.15
"""A stick that is let go rests so far from its middle at most, as a share of its way."""


class Hand:
    """What a hand wants.

    Args:
        speed_m_s: Along the ground, at 100 %.
        turn_rad_s: About the vertical, at 100 %.
        tells_release: Whether the terminal tells when a key is let go.
    """

    def __init__(self, speed_m_s: float, turn_rad_s: float, *, tells_release: bool) -> None:
        self.percent = 100
        self._speed = speed_m_s
        self._turn = turn_rad_s
        self._tells_release = tells_release
        self._held: dict[str, float] = {}
        """Until when each key counts as held [s]."""

    def press(self, key: str, now_s: float, *, repeated: bool = False) -> None:
        """Take a key that is pressed or repeats; other keys than those of the table do nothing."""
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
        """Take a key that is let go."""
        self._held.pop(key, None)

    def command(self, now_s: float, stick: Twist2D | None = None) -> Twist2D:
        """Return the velocity that is wanted [m/s, m/s, rad/s].

        Args:
            now_s: The time, by the clock of `press`.
            stick: What a gamepad adds, as shares of the speeds.
        """
        self._drop_overdue(now_s)
        parts = [DIRECTIONS[key] for key in self._held] + ([stick] if stick else [])
        x, y, yaw = (math.fsum(axis) for axis in zip(Twist2D(), *parts, strict=True))
        # no faster at a slant than straight on
        speed = self._speed * self.percent / 100 / max(math.hypot(x, y), 1.0)
        turn = self._turn * self.percent / 100 / max(abs(yaw), 1.0)
        return Twist2D(x * speed, y * speed, yaw * turn)

    def _drop_overdue(self, now_s: float) -> None:
        self._held = {key: until for key, until in self._held.items() if until > now_s}


def stick_twist(left_x: float, left_y: float, right_x: float) -> Twist2D:
    """Return what the sticks of a gamepad mean, as shares of the speeds.

    Each is from -1 to 1, to the right or towards the hand; the left stick moves, the right one
    turns.
    """
    return Twist2D(x=-_share(left_y), y=-_share(left_x), yaw=-_share(right_x))


def _share(deflection: float) -> float:
    """Return a stick's deflection without its dead zone."""
    beyond = max(abs(deflection) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
    return math.copysign(min(beyond, 1.0), deflection) if beyond else 0.0
