"""The protocol of a board: converts bytes to reports, and commands to bytes, in SI units.

A board is a subclass of `Board`, which uses neither port nor clock. Wheels are in mecazen's order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from mecazen.config import HardwareConfig
from mecazen.robot import Robot
from mecazen.wheels import WheelSpeeds


class WheelAngles(NamedTuple):
    """Angles of the wheels since power-on [rad], in the order of `WHEELS`."""

    angles: tuple[float, float, float, float]
    span: float
    """The angle at which the board's count wraps [rad]; inf: it does not wrap."""


class Inertial(NamedTuple):
    """Angular velocity [rad/s] and specific force [m/s²] in base_link."""

    angular: tuple[float, float, float]
    force: tuple[float, float, float]


class Voltage(NamedTuple):
    """Voltage of the battery [V]."""

    volts: float


class Identity(NamedTuple):
    """Name and version of the board that answers."""

    name: str
    problem: str = ""
    """Why the driver can't use the board; empty if it can."""


Report = WheelAngles | Inertial | Voltage | Identity


class Board(ABC):
    """The protocol of one kind of board, with the state of its receiver."""

    CYCLE_S: ClassVar[float]
    """Time between two reports of the wheels [s]."""
    BAUD: ClassVar[int] = 115200
    SPACING_S: ClassVar[float]
    """Minimum time between the starts of two frames to the board [s]."""
    KINDS: ClassVar[tuple[type[Report], ...]]
    """The reports that the board sends periodically."""

    def __init__(self, config: HardwareConfig, robot: Robot) -> None:
        self.config, self.robot = config, robot
        self.frames = 0
        """Number of complete frames received."""
        self.refused = 0
        """Number of times that bytes were skipped to find the next frame."""

    @abstractmethod
    def hello(self) -> Sequence[bytes]:
        """Return the frames that request the board's identity and start its reports."""

    @abstractmethod
    def feed(self, data: bytes) -> list[Report]:
        """Return the reports that the bytes complete."""

    @abstractmethod
    def drive(self, speeds: WheelSpeeds) -> tuple[bytes, WheelSpeeds]:
        """Return the frame for wheel speeds [rad/s], and the speeds that the board will drive.

        Raises:
            ValueError: A speed is not finite.
        """

    @abstractmethod
    def stop(self) -> Sequence[bytes]:
        """Return the frames that stop all motors."""

    @abstractmethod
    def turn_wheel(self, wheel: int, share: float) -> bytes:
        """Return the frame that turns one wheel, of the order of `WHEELS`, for the checklist.

        `share` is a share of the motor's full speed or voltage, from -1 to 1.
        """
