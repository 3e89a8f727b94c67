"""Faults on request: random damage of frames, and events at given times."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field

from mecazen.errors import ConfigError

CHANCES = {
    "drop": "a frame is lost",
    "corrupt": "a byte of a frame is another",
    "cut": "a frame ends early",
    "merge": "a frame comes together with the next one, with no gap",
}
EVENTS = {
    "silence": "the board sends nothing more",
    "unplug": "the cable is pulled: the port is gone, the motors go on",
    "brownout": "the battery falls to 9 V",
    "jump": "the encoder of a wheel jumps by 5000 counts",
}
DELAY = "delay"


@dataclass
class Faults:
    """Faults of the frames of one direction.

    Args:
        chances: Probability of each kind of damage, by name.
        seed: Seed of the damage.
    """

    chances: dict[str, float]
    seed: int = 0
    damaged: int = 0
    """Number of frames that were lost or changed."""
    _held: bytes = b""
    _random: random.Random = field(default_factory=random.Random)

    def __post_init__(self) -> None:
        self._random.seed(self.seed)

    def pass_on(self, frame: bytes) -> bytes:
        """Return the bytes that arrive for a frame; merged frames arrive together."""
        if not frame or not self.chances:
            return frame
        drawn = {name: self._random.random() < chance for name, chance in self.chances.items()}
        self.damaged += any(drawn.values())
        if drawn.get("drop"):
            frame = b""
        if frame and drawn.get("corrupt"):
            at, bit = self._random.randrange(len(frame)), 1 << self._random.randrange(8)
            frame = frame[:at] + bytes((frame[at] ^ bit,)) + frame[at + 1 :]
        if frame and drawn.get("cut"):
            frame = frame[: self._random.randrange(len(frame))]
        if drawn.get("merge"):
            self._held += frame
            return b""
        frame, self._held = self._held + frame, b""
        return frame


@dataclass
class Requested:
    """The faults that a command line requests."""

    chances: dict[str, float]
    events: dict[str, float]
    """Time of each event since the first command [s], by name."""
    delay_s: float = 0.0
    """Delay of each byte, in either direction [s]."""


def parse_faults(texts: Sequence[str]) -> Requested:
    """Parse faults of the forms `NAME=CHANCE`, `NAME@SECONDS` and `delay=SECONDS`.

    Raises:
        ConfigError: A fault is unknown, or its number is out of range.
    """
    found = Requested({}, {})
    for text in texts:
        is_event = "@" in text
        name, _, number = text.partition("@" if is_event else "=")
        try:
            value = float(number)
        except ValueError:
            value = -1.0
        if is_event and name in EVENTS and value >= 0.0:
            found.events[name] = value
        elif not is_event and name == DELAY and 0.0 <= value <= 10.0:
            found.delay_s = value
        elif not is_event and name in CHANCES and 0.0 <= value <= 1.0:
            found.chances[name] = value
        else:
            chances = ", ".join(f"{one}=CHANCE" for one in CHANCES)
            events = ", ".join(f"{one}@SECONDS" for one in EVENTS)
            raise ConfigError(f"--fault {text}: allowed are {chances}, {DELAY}=SECONDS, {events}")
    return found
