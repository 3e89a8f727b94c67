"""Several robots in one world: what each costs in a tick, apart and where they touch."""

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
from mecazen_bench.scenarios import robot

COUNTS = (1, 2, 4, 8)
APART_M = 3.0
STEPS = 10
"""Of 1 ms in a tick."""
WARM_UP_TICKS = 50
BLOCK_TICKS = 50
BLOCKS = 5
MOTIONS = (
    (6.0, 6.0, 6.0, 6.0),
    (-6.0, 6.0, 6.0, -6.0),
    (-6.0, 6.0, -6.0, 6.0),
    (9.0, 2.0, 2.0, 9.0),
)
"""Straight, strafe, spin and diagonal [rad/s]; in pairs there and back, so that all stay apart."""
LINEAR = Target.around(1.0, 0.1)


class Crew:
    """Some robots that drive."""

    def __init__(self, starts: Sequence[Pose2D], *, back_and_forth: bool) -> None:
        nexus = robot("nexus")
        self.count = len(starts)
        self.spent_s: list[float] = []
        self._world = World([(nexus, start) for start in starts], PhysicsConfig())
        self._back_and_forth = back_and_forth
        self._blocks = 0
        self._drive(WARM_UP_TICKS, MOTIONS[0])

    def measure(self) -> None:
        """Note the processor time of a robot's tick [s], a mean over a block."""
        motion: Sequence[float] = MOTIONS[0]
        if self._back_and_forth:
            motion = MOTIONS[self._blocks // 2 % len(MOTIONS)]
            if self._blocks % 2:
                motion = [-speed for speed in motion]
        self._blocks += 1
        self._drive(5, motion)  # what turns the wheels round is not counted
        begin = time.thread_time()
        self._drive(BLOCK_TICKS, motion)
        self.spent_s.append((time.thread_time() - begin) / BLOCK_TICKS / self.count)

    def _drive(self, ticks: int, motion: Sequence[float]) -> None:
        commands = [WheelCommand(motion)] * self.count
        for _ in range(ticks):
            self._world.advance(commands, STEPS)


def run(blocks: int = BLOCKS) -> list[Group]:
    """Measure robots apart, and two that push each other."""
    crews = {
        f"{count} apart": Crew(
            [Pose2D(0.0, APART_M * number) for number in range(count)], back_and_forth=True
        )
        for count in COUNTS
    }
    crews["2 head on"] = Crew([Pose2D(), Pose2D(0.6, 0.0, math.pi)], back_and_forth=False)
    for _ in range(blocks):
        for crew in crews.values():
            crew.measure()
    one = statistics.median(crews["1 apart"].spent_s)
    rows = []
    for name, crew in crews.items():
        seconds = statistics.median(crew.spent_s)
        goal: Target | Better = LINEAR if name.endswith("apart") else "less"
        figures = {
            "µs/robot and tick": Figure.of(seconds * 1e6, "less"),
            "of one alone": Figure.of(seconds / one, goal),
        }
        rows.append(Row(name, figures))
    how = (
        f"processor time in one process, physics alone, nexus at 1 ms, {STEPS} steps a tick, in "
        f"turns, median of {blocks} blocks; 1 is growing linearly with the number of robots"
    )
    return [Group("Several robots", how, tuple(rows))]
