"""Driving by hand: held keys and the sticks of a gamepad to a velocity, without terminal and bus.

Most terminals do not report releases. For a held key they report the press, the first repeat after
about half a second, and then some tens of repeats a second. Only the key that was pressed last
repeats. A key therefore counts as held until its next repeat is overdue. Terminals with kitty's
keyboard protocol report releases; there several keys can be held at once.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any

from mecazen.geometry import Twist2D

FIRST_S = 0.7
"""Maximum time from a press to the first repeat [s]: 0.66 s in X, 0.5 s on most desktops."""
REPEAT_S = 0.25
"""Maximum time between two repeats [s]: 0.04 s, and the delay of a network."""
SILENCE_S = 2.0
"""If releases are reported, keys count as released after this silence [s]: the line may be cut."""

_AHEAD, _BACK = Twist2D(x=1.0), Twist2D(x=-1.0)
_LEFT, _RIGHT = Twist2D(yaw=1.0), Twist2D(yaw=-1.0)
DIRECTIONS = {
    **{"w": _AHEAD, "up": _AHEAD, "s": _BACK, "down": _BACK},
    **{"j": _LEFT, "left": _LEFT, "l": _RIGHT, "right": _RIGHT},
    **{"a": Twist2D(y=1.0), "d": Twist2D(y=-1.0)},
    # curves, for terminals that report one key at a time
    **{"u": Twist2D(x=1.0, yaw=1.0), "o": Twist2D(x=1.0, yaw=-1.0)},
}
"""Direction of each key, as shares of the speeds."""
SPEEDS = {"-": -10, "_": -10, "+": 10, "=": 10}
"""Change of the speeds by each key [%]."""
MIN_PERCENT, MAX_PERCENT = 10, 300
STOP = "space"
HELP = "w a s d or ↑ ↓ move · ← → or j l turn · u o curve · + - speed · space stops · q ends"

SDL = {
    "SDL_VIDEODRIVER": "dummy",  # no window,
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",  # so none has the focus
    "SDL_NO_SIGNAL_HANDLERS": "1",
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
}
FULL_DEFLECTION = 32768.0
DEAD_ZONE = 0.15
"""Maximum deflection of a released stick, as a share of its full deflection."""


class Hand:
    """The velocity commanded by hand.

    Args:
        speed_m_s: Speed along the ground at 100 % [m/s].
        turn_rad_s: Yaw rate at 100 % [rad/s].
        reports_release: Whether the terminal reports the release of a key.
    """

    def __init__(self, speed_m_s: float, turn_rad_s: float, *, reports_release: bool) -> None:
        self.percent = 100
        self._speed = speed_m_s
        self._turn = turn_rad_s
        self._reports_release = reports_release
        self._held: dict[str, float] = {}
        """Time until which each key counts as held [s]."""

    def press(self, key: str, time_s: float, *, repeated: bool = False) -> None:
        """Process a press or repeat of a key; keys outside the tables have no effect."""
        if key == STOP:
            self._held = {}
        elif key in SPEEDS:
            self.percent = min(max(self.percent + SPEEDS[key], MIN_PERCENT), MAX_PERCENT)
        elif key in DIRECTIONS:
            self._drop_overdue(time_s)
            if not self._reports_release:
                self._held = {key: time_s + (REPEAT_S if key in self._held else FIRST_S)}
            elif not repeated or key in self._held:
                # only the newest key repeats: while it does, the others are held as well
                self._held = dict.fromkeys((*self._held, key), time_s + SILENCE_S)

    def release(self, key: str) -> None:
        """Process the release of a key."""
        self._held.pop(key, None)

    def command(self, time_s: float, stick: Twist2D | None = None) -> Twist2D:
        """Return the commanded velocity [m/s, m/s, rad/s].

        Args:
            time_s: The time on the clock of `press` [s].
            stick: Contribution of a gamepad, as shares of the speeds.
        """
        self._drop_overdue(time_s)
        shares = [stick or Twist2D(), *(DIRECTIONS[key] for key in self._held)]
        x, y, yaw = (math.fsum(axis) for axis in zip(*shares, strict=True))
        # diagonal motion is no faster than straight motion
        speed = self._speed * self.percent / 100 / max(math.hypot(x, y), 1.0)
        turn = self._turn * self.percent / 100 / max(abs(yaw), 1.0)
        return Twist2D(x * speed, y * speed, yaw * turn)

    def _drop_overdue(self, time_s: float) -> None:
        self._held = {key: until_s for key, until_s in self._held.items() if until_s > time_s}


def find_gamepad() -> tuple[Callable[[], Twist2D], str]:
    """Find the first gamepad that is plugged in; SDL knows the sticks of most models.

    Returns:
        A function that returns the velocity of its sticks as shares of the speeds, zero without a
        gamepad; and a line for the user.
    """
    os.environ.update(SDL)
    try:
        import pygame  # noqa: PLC0415  # an extra
        from pygame._sdl2 import controller  # noqa: PLC0415
    except ImportError:
        return Twist2D, "keyboard only: a gamepad needs pip install 'mecazen[gamepad]'"
    try:
        pygame.display.init()
        controller.init()
        known = [n for n in range(controller.get_count()) if controller.is_controller(n)]
        pad: Any = controller.Controller(known[0]) if known else None
    except pygame.error as error:
        return Twist2D, f"keyboard only: no gamepad can be read: {error}"
    if pad is None:
        return Twist2D, "keyboard only: no gamepad is plugged in"

    def deflection(axis: int) -> float:
        """Return a stick's deflection from -1 to 1, without its dead zone."""
        share = pad.get_axis(axis) / FULL_DEFLECTION
        beyond = max(abs(share) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
        return math.copysign(beyond, share) if beyond else 0.0

    def twist() -> Twist2D:
        pygame.event.pump()
        if not pad.attached():
            return Twist2D()
        # positive to the right and towards the hand
        return Twist2D(
            x=-deflection(pygame.CONTROLLER_AXIS_LEFTY),
            y=-deflection(pygame.CONTROLLER_AXIS_LEFTX),
            yaw=-deflection(pygame.CONTROLLER_AXIS_RIGHTX),
        )

    return twist, f"gamepad {pad.name}: the left stick moves, the right one turns"
