"""One cycle of a steady gait: planted feet, and the pelvis that suits the curves best.

In stance, the curves give the foot's pitch and with it, as it rolls on the ground, the place of
the ankle; over it they place the hip. The pelvis follows both hips, each with a weight that grows
from 0 after heel strike and shrinks to 0 before toe-off, low-passed. In swing, the curves hang the
foot from that pelvis. So swing has the curves' angles, and stance nearly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen_target.body.norm import PELVIS_TILT, Factors, Fourier
from mecazen_target.body.segments import Segments
from mecazen_target.body.style import Style

SAMPLES = 100
"""Of the pelvis over the cycle; of a leg over its stance, and as many over its swing."""
_HARMONICS = 8  # of the pelvis
_CLEARANCE = 0.007  # about the least in the middle of the swing [m]
_TIED = 0.4  # share of the swing over which each end is tied to the stance
_RAMP = 0.06  # share of the stance over which the foot leaves the ground
_FLAT = (
    0.11 / 0.62,
    0.34 / 0.62,
)  # of the stance: the foot is flat, as curves have it within 2 deg


class Swings(NamedTuple):
    """Amplitudes of what swings once a cycle, and is prescribed: [m] and [rad]."""

    sway: float
    pelvis_yaw: float
    pelvis_roll: float
    trunk_yaw: float
    arm: float

    @classmethod
    def of(cls, factors: Factors) -> Swings:
        """Return the amplitudes of a row of the table."""
        return cls(
            factors.sway_m,
            math.radians(factors.pelvis_rotation_deg),
            math.radians(factors.pelvis_obliquity_deg),
            math.radians(factors.trunk_rotation_deg),
            math.radians(factors.arm_swing_deg),
        )

    def pelvis(self, phase: float) -> tuple[float, float, float]:
        """Return the pelvis's place to the left, its yaw and its roll (left side up) at a phase.

        The phase is the left leg's. The pelvis is furthest over the standing foot; the leading
        leg's side is ahead; the loaded side is highest at 15 % (Perry & Burnfield).
        """
        cycle = math.tau * phase
        return (
            self.sway * math.cos(cycle - 0.6 * math.pi),
            -self.pelvis_yaw * math.cos(cycle),
            self.pelvis_roll * math.cos(cycle - 0.3 * math.pi),
        )


class Leg(NamedTuple):
    """A leg over its stance (SAMPLES + 1 values), or its swing."""

    pitch: list[float]
    """Of the foot, toes up [rad]."""
    lift: list[float]
    """Of the foot's lowest point [m]; 0 in stance."""
    progress: list[float]
    """In the world, from 0 where the foot stood to 1 where it will; 0 in stance."""


class Cycle(NamedTuple):
    """A steady gait at one speed."""

    speed: float
    stride: float
    stance_shares: tuple[float, float]
    leads: tuple[float, float]
    """Forward places of the standing feet at half stance, from the path's pose [m]."""
    swings: Swings
    forward: list[float]
    """Of the pelvis from the path's pose over the left leg's phase, SAMPLES + 1 values [m]."""
    height: list[float]
    """Of the pelvis [m]."""
    legs: tuple[tuple[Leg, Leg], tuple[Leg, Leg]]
    """Stance and swing of the left leg and of the right one."""


class _Step(NamedTuple):
    """What the curves want of a leg at one phase."""

    pitch: float
    reach: float
    """Forward from hip to ankle [m]."""
    drop: float
    """Down from hip to ankle [m]."""


def solve(style: Style, segments: Segments, speed: float) -> Cycle:
    """Return the cycle at a `speed` [m/s]."""
    stride, swings = style.stride(speed), Swings.of(style.factors(speed))
    shares = (style.stance_share(0, speed), style.stance_share(1, speed))
    own_leads = (style.lead(0, speed), style.lead(1, speed))
    half, inwards = segments.hips / 2, (segments.hips - segments.step_width) / 2

    def hip(side: int, phase: float) -> tuple[float, float, float]:
        """Return a hip's forward and upward place from the pelvis, and its left one from the foot."""
        (sway, yaw, roll), sign = swings.pelvis(phase), 1 - 2 * side
        return (
            -sign * half * math.sin(yaw),
            sign * half * math.sin(roll),
            sign * inwards + sway,
        )

    def step(side: int, leg_phase: float, left: float) -> _Step:
        flexion, knee, ankle = style.angles(side, speed, leg_phase)
        thigh = flexion - PELVIS_TILT
        shank = thigh - knee
        down = segments.thigh * math.cos(thigh) + segments.shank * math.cos(shank)
        reach = segments.thigh * math.sin(thigh) + segments.shank * math.sin(shank)
        return _Step(shank + ankle, reach, math.sqrt(down * down - left * left))

    def stance_pitch(part: float, pitch: float) -> float:
        if part < _FLAT[0]:
            return max(pitch, 0.0) * _smooth((_FLAT[0] - part) / _RAMP)
        return min(pitch, 0.0) * _smooth((part - _FLAT[1]) / _RAMP)

    def ends(side: int) -> tuple[float, float]:
        """Return the pitch of a foot at heel strike and at toe-off."""
        return (
            max(step(side, 0.0, 0.0).pitch, 0.0),
            min(step(side, shares[side], 0.0).pitch, 0.0),
        )

    def wanted(phase: float) -> tuple[float, float]:
        """Return the pelvis's forward place from the path's pose, and its height."""
        total = forward = height = 0.0
        for side in (0, 1):
            share = shares[side]
            leg_phase = math.fmod(phase + side * style.offset, 1.0)
            if leg_phase >= share:
                continue
            weight = _smooth(min(leg_phase, share - leg_phase) / max(share - 0.5, 0.05))
            x, z, left = hip(side, phase)
            want = step(side, leg_phase, left)
            roll_x, roll_z = segments.roll(stance_pitch(leg_phase / share, want.pitch))
            base = stride * (share / 2 - leg_phase) + own_leads[side]
            total += weight
            forward += weight * (base + roll_x - want.reach - x)
            height += weight * (roll_z + want.drop - z)
        return forward / total, height / total

    # between the samples, where no leg's weight is exactly 0
    phases = [(i + 0.5) / SAMPLES for i in range(SAMPLES)]
    places = [wanted(phase) for phase in phases]
    ahead = Fourier([x for x, _ in places], _HARMONICS)
    height = Fourier([z for _, z in places], _HARMONICS)
    middle = -ahead.mean
    late = 0.5 / SAMPLES

    def leg(side: int) -> tuple[Leg, Leg]:
        share = shares[side]
        parts = [i / SAMPLES for i in range(SAMPLES + 1)]
        stance = Leg(
            [stance_pitch(u, step(side, share * u, 0.0).pitch) for u in parts],
            [0.0] * len(parts),
            [0.0] * len(parts),
        )
        swing: list[tuple[float, float, float]] = []
        strike, off = ends(side)
        pitches = [step(side, share + (1.0 - share) * u, 0.0).pitch for u in parts[:-1]]
        pitches.append(step(side, 0.0, 0.0).pitch)
        for u, pitch in zip(parts, pitches, strict=True):
            leg_phase = share + (1.0 - share) * u
            phase = math.fmod(leg_phase + 1.0 - side * style.offset, 1.0)
            x, z, left = hip(side, phase)
            want = step(side, math.fmod(leg_phase, 1.0), left)
            early, final = _ties(u)
            pitch += early * (off - pitches[0]) + final * (strike - pitches[-1])  # noqa: PLW2901
            roll_x, roll_z = segments.roll(pitch)
            pelvis_x, pelvis_z = ahead.at(phase - late), height.at(phase - late)
            swing.append(
                (
                    pitch,
                    pelvis_z + z - want.drop - roll_z,
                    (pelvis_x + x + want.reach - roll_x - own_leads[side]) / stride
                    + leg_phase
                    - share / 2,
                )
            )
        first, last = swing[0], swing[-1]
        tied = Leg([], [], [])
        for u, (pitch, lift, progress) in zip(parts, swing, strict=True):
            early, final = _ties(u)
            bump = 16.0 * (u * (1.0 - u)) ** 2
            lift -= early * first[1] + final * last[1]  # noqa: PLW2901
            tied.pitch.append(pitch)
            tied.lift.append(_larger(lift, _CLEARANCE * bump, 0.006 * bump))
            tied.progress.append(progress - early * first[2] - final * (last[2] - 1.0))
        return stance, tied

    grid = [i / SAMPLES - late for i in range(SAMPLES + 1)]
    return Cycle(
        speed,
        stride,
        shares,
        (middle + own_leads[0], middle + own_leads[1]),
        swings,
        [ahead.at(phase) + middle for phase in grid],
        [height.at(phase) for phase in grid],
        (leg(0), leg(1)),
    )


def _larger(a: float, b: float, width: float) -> float:
    """Return the larger of two values, without a kink where they are about `width` apart."""
    return (a + b + math.sqrt((a - b) ** 2 + width * width)) / 2


def _ties(u: float) -> tuple[float, float]:
    """Return how much of what is off at the beginning and at the end of a swing is taken off."""
    return 1.0 - _smooth(u / _TIED), _smooth((u - 1.0) / _TIED + 1.0)


def _smooth(u: float) -> float:
    """Return the smooth step from 0 at 0 to 1 at 1."""
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)
