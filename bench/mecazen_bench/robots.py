"""Several robots in one world: processor time per robot and tick, apart and in contact."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Sequence
from itertools import chain, cycle, repeat
from random import Random

from mecazen.config import PhysicsConfig
from mecazen.config.services import MAX_DT_S
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.stack import robot

COUNTS = (1, 2, 4, 8, 64)
APART_M = 3.0
CROWD, CROWD_M, CROWD_DT_S = 16, 4.0, 0.0025
"""Number of robots in the crowd, side of their square [m], and physics step [s]."""
CROWD_RAD_S = 15.0
"""Maximum speed of the wheels in the crowd."""
TICK_S = 0.01
WARM_UP_TICKS = 50
REVERSAL_TICKS = 5
"""Number of ticks in which the wheels change direction, which are not measured."""
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

Commands = Iterator[list[WheelCommand]]
"""Commands of all robots: for the warm-up, and for the reversal and the measured part of each
block."""


def _apart(count: int) -> Iterator[float]:
    starts = [Pose2D(0.0, APART_M * number) for number in range(count)]
    motions = [[sign * v for v in motion] for motion in MOTIONS for sign in (1.0, -1.0)]
    legs = ([WheelCommand(motion)] * count for motion in cycle(motions))
    first = next(legs)
    return _spent_s(starts, chain([first] * 3, (leg for leg in legs for _ in range(2))))


def _head_on() -> Iterator[float]:
    starts = [Pose2D(), Pose2D(0.6, 0.0, math.pi)]
    return _spent_s(starts, repeat([WheelCommand(MOTIONS[0])] * 2))


def _crowd() -> Iterator[float]:
    """Measure robots on a grid that drive at random, come close to each other, and push."""
    random = Random(1)  # noqa: S311 - not for secrets
    row = math.isqrt(CROWD)
    places = [(number + 0.5) * CROWD_M / row for number in range(row)]
    starts = [Pose2D(x, y, random.uniform(-math.pi, math.pi)) for x in places for y in places]

    def speeds() -> list[float]:
        return [random.uniform(-CROWD_RAD_S, CROWD_RAD_S) for _ in WHEELS]

    commands = ([WheelCommand(speeds()) for _ in starts] for _ in repeat(None))
    return _spent_s(starts, commands, CROWD_DT_S)


def _spent_s(
    starts: Sequence[Pose2D], commands: Commands, dt_s: float = MAX_DT_S
) -> Iterator[float]:
    """Yield the mean processor time of one robot's tick in each block [s]."""
    nexus = robot("nexus")
    world = Simulation([(nexus, start) for start in starts], PhysicsConfig(dt_s=dt_s))

    def advance(ticks: int) -> None:
        wanted = next(commands)
        for _ in range(ticks):
            world.advance(wanted, round(TICK_S / dt_s))

    advance(WARM_UP_TICKS)
    while True:
        advance(REVERSAL_TICKS)
        begin = time.thread_time()
        advance(BLOCK_TICKS)
        yield (time.thread_time() - begin) / BLOCK_TICKS / len(starts)


def run(blocks: int = BLOCKS) -> list[Group]:
    """Measure robots apart, two robots that push each other, and a crowd."""
    cases = {f"{count} apart": (count, _apart(count)) for count in COUNTS}
    cases["2 head on"] = 2, _head_on()
    cases[f"{CROWD} in a crowd"] = CROWD, _crowd()
    spent: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(blocks):
        for name, (_, case) in cases.items():
            spent[name].append(next(case))
    seconds = {name: statistics.median(each) for name, each in spent.items()}
    rows = {
        name: {
            "µs/robot and tick": Figure(one_s * 1e6, "less"),
            "relative to one robot": Figure(
                one_s / seconds["1 apart"], LINEAR if name.endswith("apart") else "less"
            ),
            "× real time": Figure(
                TICK_S / one_s / cases[name][0],
                "more" if name.endswith("apart") else REAL_TIME,
            ),
        }
        for name, one_s in seconds.items()
    }
    how = (
        f"processor time in one process, physics only, nexus at {MAX_DT_S * 1e3:g} ms; the crowd "
        f"within {CROWD_M:g} x {CROWD_M:g} m, at {CROWD_DT_S * 1e3:g} ms; interleaved, median of "
        f"{blocks} blocks; 1 means linear in the number of robots"
    )
    return [Group("Several robots", how, rows)]
