"""A gamepad, read by SDL, which knows the sticks of most models."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from typing import Any

from mecazen.geometry import Twist2D

from mecazen_tools.driving import stick_twist

SDL = {
    "SDL_VIDEODRIVER": "dummy",  # no window,
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",  # so none has the focus
    "SDL_NO_SIGNAL_HANDLERS": "1",
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
}
FULL = 32768.0
"""A stick's deflection at its end."""


def find() -> tuple[Callable[[], Twist2D] | None, str]:
    """Find the first gamepad that is plugged in at the start.

    Returns:
        A function that returns the velocity of its sticks as shares of the speeds, and zero once it
        is unplugged; None without a gamepad. And a line for the user.
    """
    os.environ.update(SDL)
    try:
        import pygame  # noqa: PLC0415  # an extra
        from pygame._sdl2 import controller  # noqa: PLC0415
    except ImportError:
        return None, "keyboard only: a gamepad needs pip install 'mecazen[gamepad]'"
    try:
        pygame.display.init()
        controller.init()
        known = [n for n in range(controller.get_count()) if controller.is_controller(n)]
        pad: Any = controller.Controller(known[0]) if known else None
    except pygame.error as error:
        return None, f"keyboard only: no gamepad can be read: {error}"
    if pad is None:
        return None, "keyboard only: no gamepad is plugged in"
    return partial(
        _twist, pygame, pad
    ), f"gamepad {pad.name}: the left stick moves, the right one turns"


def _twist(game: Any, pad: Any) -> Twist2D:
    game.event.pump()
    if not pad.attached():
        return Twist2D()
    axes = game.CONTROLLER_AXIS_LEFTX, game.CONTROLLER_AXIS_LEFTY, game.CONTROLLER_AXIS_RIGHTX
    return stick_twist(*(pad.get_axis(axis) / FULL for axis in axes))
