"""Several robots in one world: processor time of each in a tick, apart and in contact."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from random import Random

from mecazen.config import PhysicsConfig
from mecazen.config.physics import MAX_DT_S
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen.watchdog import WheelCommand
from mecazen_physics.simulation import Simulation

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.stack import robot

COUNTS = (1, 2, 4, 8, 64)
APART_M = 3.0
CROWD, CROWD_M, CROWD_DT_S = 16, 4.0, 0.0025
"""So many robots in a square of this side, with this step."""
CROWD_RAD_S = 15.0
"""Highest speed of their wheels."""
TICK_S = 0.01
WARM_UP_TICKS = 50
REVERSAL_TICKS = 5
"""In which the wheels change direction: not counted."""
BLOCK_TICKS = 50
BLOCKS = 5
MOTIONS = (
    (6.0, 6.0, 6.0, 6.0),
    (-6.0, 6.0, 6.0, -6.0),
    (-6.0, 6.0, -6.0, 6.0),
    (9.0, 2.0, 2.0, 9.0),
)
"""Wheel speeds of forward, lateral, yaw and diagonal motion [rad/s]."""
LINEAR: Goal = (None, 1.1)
REAL_TIME: Goal = (1.0, None)

Drive = Callable[[int], list[WheelCommand]]
"""Commands of all robots, by the number of the block."""


class Robots:
    """Some robots that drive."""

    def __init__(self, starts: Sequence[Pose2D], drive: Drive, dt_s: float = MAX_DT_S) -> None:
        self.count = len(starts)
        self.spent_s: list[float] = []
        """Processor time of one robot's tick, a mean for each block."""
        self._drive, self._steps = drive, round(TICK_S / dt_s)
        nexus = robot("nexus")
        self._world = Simulation([(nexus, start) for start in starts], PhysicsConfig(dt_s=dt_s))
        self._advance(WARM_UP_TICKS)

    def measure(self) -> None:
        self._advance(REVERSAL_TICKS)
        begin = time.thread_time()
        self._advance(BLOCK_TICKS)
        self.spent_s.append((time.thread_time() - begin) / BLOCK_TICKS / self.count)

    def _advance(self, ticks: int) -> None:
        commands = self._drive(len(self.spent_s))
        for _ in range(ticks):
            self._world.advance(commands, self._steps)


def _there_and_back(count: int) -> Drive:
    def drive(block: int) -> list[WheelCommand]:
        leg, is_back = divmod(block, 2)
        motion = [-v if is_back else v for v in MOTIONS[leg % len(MOTIONS)]]
        return [WheelCommand(motion)] * count

    return drive


def _head_on(block: int) -> list[WheelCommand]:
    del block
    return [WheelCommand(MOTIONS[0])] * 2


def _crowd() -> Robots:
    """Return robots on a grid, which drive anywhere: they come close to each other, and push."""
    random = Random(1)  # noqa: S311 - not for secrets
    row = math.isqrt(CROWD)
    places = [(number + 0.5) * CROWD_M / row for number in range(row)]
    starts = [Pose2D(x, y, random.uniform(-math.pi, math.pi)) for x in places for y in places]

    def drive(block: int) -> list[WheelCommand]:
        del block
        return [
            WheelCommand([random.uniform(-CROWD_RAD_S, CROWD_RAD_S) for _ in WHEELS])
            for _ in range(CROWD)
        ]

    return Robots(starts, drive, CROWD_DT_S)


def run(blocks: int = BLOCKS) -> list[Group]:
    """Measure robots apart, two that push each other, and a crowd."""
    cases = {
        f"{count} apart": Robots(
            [Pose2D(0.0, APART_M * number) for number in range(count)], _there_and_back(count)
        )
        for count in COUNTS
    }
    cases["2 head on"] = Robots([Pose2D(), Pose2D(0.6, 0.0, math.pi)], _head_on)
    cases[f"{CROWD} in a crowd"] = _crowd()
    for _ in range(blocks):
        for case in cases.values():
            case.measure()
    seconds = {name: statistics.median(case.spent_s) for name, case in cases.items()}
    rows = {
        name: {
            "µs/robot and tick": Figure(spent * 1e6, "less"),
            "relative to one robot": Figure(
                spent / seconds["1 apart"], LINEAR if name.endswith("apart") else "less"
            ),
            "× real time": Figure(
                TICK_S / spent / cases[name].count,
                "more" if name.endswith("apart") else REAL_TIME,
            ),
        }
        for name, spent in seconds.items()
    }
    how = (
        f"processor time in one process, physics only, nexus at {MAX_DT_S * 1e3:g} ms; the crowd "
        f"within {CROWD_M:g} x {CROWD_M:g} m, at {CROWD_DT_S * 1e3:g} ms; interleaved, median of "
        f"{blocks} blocks; 1 means linear in the number of robots"
    )
    return [Group("Several robots", how, rows)]
