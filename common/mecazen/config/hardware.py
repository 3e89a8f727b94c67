"""`[hardware]`: a real robot in the place of physics."""

from __future__ import annotations

from typing import Annotated

import msgspec

from mecazen.schema import NonNegative, Positive, Section


class HardwareConfig(Section):
    """The board of a robot, its port, and when its motors are stopped."""

    board: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+$")] = "rosmaster_x3"
    """An installed board, by its name."""
    port: Annotated[str, msgspec.Meta(min_length=1)] = "/dev/ttyUSB0"
    """A serial port, or `socket://HOST:PORT`."""
    dry_run: bool = False
    """Whether frames are printed instead of sent; simulated wheels then turn as commanded."""
    counts_per_turn: Positive | None = None
    """Encoder counts in a turn of a wheel; left out: the value in the firmware."""
    command_timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=0.3)] = 0.2
    """Age of a wheel command above which the robot brakes; with a guard, guard.hold_s applies if it
    is less. The motors are stopped at most 0.5 s after the last command."""
    report_timeout_s: Annotated[float, msgspec.Meta(ge=0.1, le=0.4)] = 0.25
    """Time without a report of the wheels after which the motors are stopped."""
    min_voltage_v: NonNegative = 9.9
    """Voltage below which the motors are stopped after 1 s, until a restart."""
