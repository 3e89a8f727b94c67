"""Stops the motors if the driver crashes, freezes or falls silent; runs as a separate process.

The board executes its last command for ever, so a process has to outlive the driver. This process
holds the same open port. It receives one byte for each frame that the driver sends. If no byte
comes for a while after motion, or the driver has ended for any reason, the keeper sends the frames
that stop the motors.

It runs as a standalone file, `python keeper.py`, and imports nothing from mecazen.
"""

import os
import select
import sys
import time
from contextlib import suppress

PRIORITY = 50
"""Real-time priority, above that of all services; the keeper hardly ever runs."""
DRIVE, STOP = b"d", b"s"
"""Heartbeat bytes: for a frame that may move the robot, and for a frame that stops it."""


def keep(port: int, heartbeat: int, silence_s: float, spacing_s: float, frames: list[bytes]) -> int:
    """Watch a driver until it ends; return how often the keeper stopped the motors."""
    with suppress(OSError):  # if allowed, so that the keeper wakes up in time on a busy host
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    stops, moving = 0, False
    while True:
        ready, _, _ = select.select([heartbeat], [], [], silence_s if moving else None)
        if beats := os.read(heartbeat, 4096) if ready else b"":
            moving = beats[-1:] == DRIVE
            continue
        stops += 1
        for frame in frames:
            time.sleep(spacing_s)
            try:
                os.write(port, frame)
            except OSError:  # the port is gone, or its buffer is full
                break
        if ready:
            return stops
        moving = False


if __name__ == "__main__":
    port, heartbeat, silence_s, spacing_s, *frames = sys.argv[1:]
    keep(
        int(port), int(heartbeat), float(silence_s), float(spacing_s), [*map(bytes.fromhex, frames)]
    )
