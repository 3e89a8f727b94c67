"""The configured person: on a path or driven by hand, with or without gait oscillation."""

from __future__ import annotations

from mecazen.geometry import Twist2D

from mecazen_target import config
from mecazen_target.driven import Driven
from mecazen_target.gait import with_gait
from mecazen_target.motion import Motion
from mecazen_target.paths import make_path, start_pose


class Walker:
    """The person's motion by tick.

    Raises:
        ValueError: See `make_path`.
    """

    def __init__(self, person: config.TargetConfig, tick_s: float) -> None:
        self._config = person
        self._tick_s = tick_s
        self._path = None if isinstance(person.path, config.Driven) else make_path(person.path)
        self.reset()

    def reset(self) -> None:
        """Put the person back to the start."""
        path = self._config.path
        timeout_s = path.timeout_s if isinstance(path, config.Driven) else 0.0
        self._driven = Driven(start_pose(path), timeout_s, self._tick_s)
        self._tick = 0
        self.distance = 0.0
        """Distance travelled since the start [m]."""

    def command(self, twist: Twist2D) -> None:
        """Drive the person by hand; no effect on a person on a path."""
        self._driven.command(twist)

    def at(self, tick: int) -> Motion:
        """Return the motion at a tick, which is not before the last one."""
        if self._path is not None:
            motion = self._path.at(tick * self._tick_s)
        else:
            missed = tick - self._tick
            motion = self._driven.step(missed) if missed else self._driven.motion
        self._tick = tick
        self.distance = motion.distance
        return motion if self._config.gait is None else with_gait(motion, self._config.gait)
