"""Random walkers, on whom a follower's constants are chosen and judged: numbered and repeatable.

A walker's velocities (forward, left, turning) are Ornstein-Uhlenbeck processes about targets that
jump: to walking on, bends, corners, standing, turning on the spot and steps aside.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

import numpy as np
from mecazen.geometry import Twist2D
from mecazen.portable import Floats
from numpy.random import PCG64, Generator

STREAM = 2605
"""Stream of the random numbers, used with a walker's number."""
RELAXATION_1_S: Floats = np.array((4.0, 4.0, 8.0))
"""Rates at which forward, left and turning velocity approach their targets."""
DIFFUSION: Floats = np.array((0.08, 0.05, 0.25))
"""Random walks of the three velocities after 1 s [m/s, m/s, rad/s]: no person walks evenly."""
SLOWEST_M_S, FASTEST_M_S = 0.4, 1.6
"""The range of the walkers' greatest speeds."""
LEAST_RADIUS_M = 0.3
EVENNESS = 0.03, 3.0
"""The range of a walker's share of `DIFFUSION`: some walk as evenly as on a treadmill."""
PATIENCE = 1.0, 6.0
"""The range of the factor by which a walker keeps walking on, standing or bending for longer."""
GREATEST_RIPPLE = 0.2
"""Greatest change of the speed within a step, relative to the speed."""
SHARES = 0.35, 0.15, 0.15, 0.1, 0.12, 0.07, 0.06
"""The shares of the segments: walking on, bends, winding ways, corners, standing, turning on the
spot, steps aside."""
CORNER_S = 0.5
STEP_M, STEP_S = 0.3, 0.3
"""The length of a step is STEP_M at rest, and grows by STEP_S times the speed."""


class Character(NamedTuple):
    """The constants of a walker."""

    greatest: float
    """Greatest speed [m/s]."""
    evenness: float
    """Share of `DIFFUSION`, and up to 1 of the ripple."""
    patience: float
    """Factor of the durations of walking on, bends and standing."""
    ripple: float
    """Change of the speed within a step, relative to the speed."""


class Kind(Enum):
    """A behaviour that lasts for a segment."""

    WALKING_ON = 0
    BEND = 1
    WINDING_WAY = 2
    CORNER = 3
    STANDING = 4
    TURNING = 5
    """On the spot."""
    STEP_ASIDE = 6


class Segment(NamedTuple):
    """A time in which the targets of the velocities hold."""

    kind: Kind
    duration: float
    """[s]"""
    targets: tuple[float, float, float]
    """Forward and left [m/s], turning [rad/s]."""
    period: float = math.inf
    """Period of the sine by which the target of turning is multiplied [s]; infinite: constant."""

    def wave(self, time: float) -> float:
        """Return the factor of the target of turning."""
        return 1.0 if math.isinf(self.period) else math.sin(math.tau * time / self.period)


def walker(number: int) -> tuple[Character, Iterator[Segment]]:
    """Return the character of a walker, and its segments, without end."""
    random = Generator(PCG64([number, STREAM]))
    greatest = random.uniform(SLOWEST_M_S, FASTEST_M_S)
    evenness = math.exp(random.uniform(math.log(EVENNESS[0]), math.log(EVENNESS[1])))
    patience = math.exp(random.uniform(math.log(PATIENCE[0]), math.log(PATIENCE[1])))
    ripple = min(evenness, 1.0) * random.uniform(0.0, GREATEST_RIPPLE)
    character = Character(greatest, evenness, patience, ripple)
    return character, segments(random, character)


def segments(random: Generator, character: Character) -> Iterator[Segment]:
    """Yield the segments of a walker, without end."""

    def either(low: float, high: float) -> float:
        return float(random.choice((-1.0, 1.0)) * random.uniform(low, high))

    while True:
        speed = random.uniform(0.1, character.greatest)
        kind = Kind(int(random.choice(len(SHARES), p=SHARES)))
        match kind:
            case Kind.WALKING_ON:
                turn = np.clip(0.25 * random.standard_normal(), -1.0, 1.0) * min(speed, 1.0)
                duration = character.patience * random.uniform(2.0, 8.0)
                yield Segment(kind, duration, (speed, 0.0, float(turn)))
            case Kind.BEND:
                speed = min(speed, 1.0)
                turn = speed / either(LEAST_RADIUS_M, 1.5)
                duration = character.patience * min(random.uniform(1.0, 6.0) / abs(turn), 4.0)
                yield Segment(kind, duration, (speed, 0.0, turn))
            case Kind.WINDING_WAY:
                turn = either(0.1, min(1.0, speed / LEAST_RADIUS_M))
                duration, period = random.uniform(4.0, 12.0), random.uniform(4.0, 12.0)
                yield Segment(kind, character.patience * duration, (speed, 0.0, turn), period)
            case Kind.CORNER:
                angle = math.radians(either(45.0, 120.0))
                yield Segment(kind, CORNER_S, (min(speed, 0.8), 0.0, angle / CORNER_S))
            case Kind.STANDING:
                yield Segment(kind, character.patience * random.uniform(1.0, 5.0), (0.0, 0.0, 0.0))
            case Kind.TURNING:
                yield Segment(kind, random.uniform(0.5, 1.5), (0.0, 0.0, either(0.5, 2.0)))
            case Kind.STEP_ASIDE:
                yield Segment(kind, random.uniform(0.5, 1.0), (0.0, either(0.3, 0.6), 0.0))


def twists(number: int, duration: float, step: float) -> Iterator[Twist2D]:
    """Yield the velocities of walker `number`, in the person's frame, for each `step` [s]."""
    character, plan = walker(number)
    random = Generator(PCG64([number, STREAM, 1]))
    kicks = random.standard_normal((round(duration / step), 3)) * DIFFUSION * math.sqrt(step)
    velocity, phase, begin, end = np.zeros(3), 0.0, 0.0, 0.0
    segment = Segment(Kind.STANDING, 0.0, (0.0, 0.0, 0.0))
    for cell, kick in enumerate(character.evenness * kicks):
        if cell * step >= end:
            segment = next(plan)
            begin, end = end, end + segment.duration
        targets = np.array(segment.targets)
        targets[2] *= segment.wave(cell * step - begin)
        velocity = velocity + RELAXATION_1_S * (targets - velocity) * step + kick
        forward, left, turn = velocity.tolist()
        speed = math.hypot(forward, left)
        phase += math.tau * speed / (STEP_M + STEP_S * speed) * step
        swing = 1.0 + character.ripple * math.cos(phase)
        yield Twist2D(swing * forward, swing * left, turn)
