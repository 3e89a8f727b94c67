"""Several robots in one world: processor time of each in a tick, apart and in contact."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence

from mecazen.geometry import Pose2D
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.motors import WheelCommand
from mecazen_physics.world import World

from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.stack import robot

COUNTS = (1, 2, 4, 8)
APART_M = 3.0
STEPS = 10
"""Of 1 ms in a tick."""
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
LINEAR = Target(0.9, 1.1)
REAL_TIME = Target(high=5_000.0)
"""Of each of two robots [µs]: both together take less than a tick's 10 ms."""


class Robots:
    """Some robots that drive; there and back, or forward only."""

    def __init__(self, starts: Sequence[Pose2D], *, there_and_back: bool) -> None:
        nexus = robot("nexus")
        self.count = len(starts)
        self.spent_s: list[float] = []
        """Processor time of one robot's tick, a mean for each block."""
        self._world = World([(nexus, start) for start in starts], PhysicsConfig())
        self._there_and_back = there_and_back
        self._drive(WARM_UP_TICKS, MOTIONS[0])

    def measure(self) -> None:
        leg, is_back = divmod(len(self.spent_s), 2) if self._there_and_back else (0, 0)
        motion = [-v if is_back else v for v in MOTIONS[leg % len(MOTIONS)]]
        self._drive(REVERSAL_TICKS, motion)
        begin = time.thread_time()
        self._drive(BLOCK_TICKS, motion)
        self.spent_s.append((time.thread_time() - begin) / BLOCK_TICKS / self.count)

    def _drive(self, ticks: int, motion: Sequence[float]) -> None:
        commands = [WheelCommand(motion)] * self.count
        for _ in range(ticks):
            self._world.advance(commands, STEPS)


def run(blocks: int = BLOCKS) -> list[Group]:
    """Measure robots apart, and two that push each other."""
    cases = {
        f"{count} apart": Robots(
            [Pose2D(0.0, APART_M * number) for number in range(count)], there_and_back=True
        )
        for count in COUNTS
    }
    cases["2 head on"] = Robots([Pose2D(), Pose2D(0.6, 0.0, math.pi)], there_and_back=False)
    for _ in range(blocks):
        for case in cases.values():
            case.measure()
    seconds = {name: statistics.median(case.spent_s) for name, case in cases.items()}
    rows = []
    for name, spent in seconds.items():
        is_apart = name.endswith("apart")
        time_goal: Target | Better = "less" if is_apart else REAL_TIME
        goal: Target | Better = LINEAR if is_apart else "less"
        figures = {
            "µs/robot and tick": Figure.of(spent * 1e6, time_goal),
            "relative to one robot": Figure.of(spent / seconds["1 apart"], goal),
        }
        rows.append(Row(name, figures))
    how = (
        f"processor time in one process, physics only, nexus at 1 ms, {STEPS} steps a tick, "
        f"interleaved, median of {blocks} blocks; 1 means linear in the number of robots"
    )
    return [Group("Several robots", how, tuple(rows))]
