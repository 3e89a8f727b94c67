"""One cycle of a steady gait: planted feet, and the motion of the pelvis that fits the curves best.

In stance, the curves give the foot's pitch. The pitch of the rolling foot gives the place of the
ankle, and the curves place the hip over the ankle. The pelvis follows both hips, and the result is
low-passed; the weight of each hip grows from 0 after heel strike and shrinks to 0 before toe-off.
In swing, the curves give the place of the foot relative to this pelvis. So the angles are those of
the curves in swing, and nearly so in stance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from mecazen_people.body.gait import Fourier, Style
from mecazen_people.body.posture import PELVIS_TILT, Segments

SLOWEST, FASTEST, _SPEED_STEP = 0.2, 2.0, 0.2
"""Speeds of the solved cycles: first, last and difference [m/s]."""
SAMPLES = 100
"""Number of samples of the pelvis over the cycle, of a leg over its stance, and over its swing."""
_CLEARANCE = 0.007  # approximate minimum in the middle of the swing [m]
_TIED = 0.4  # share of the swing over which each end is blended into the stance
_RAMP = 0.06  # share of the stance over which the foot leaves the ground
# shares of the stance between which the foot is flat; curves then have it flat within 2 deg
_FLAT = 0.11 / 0.62, 0.34 / 0.62


class Swings(NamedTuple):
    """Amplitudes of the prescribed oscillations, which have the period of a cycle [m, rad].

    They are the last columns of `GaitFactors`, in the same order.
    """

    sway: float
    pelvis_yaw: float
    pelvis_roll: float
    trunk_yaw: float
    arm: float

    def pelvis(self, phase: float) -> tuple[float, float, float]:
        """Return the pelvis's offset to the left, its yaw and its roll (left side up) at a phase.

        The phase is the left leg's. The pelvis is furthest over the standing foot; the leading
        leg's side is ahead; the loaded side is highest at 15 % (Perry & Burnfield).
        """
        cycle = math.tau * phase
        return (
            self.sway * math.cos(cycle - 0.6 * math.pi),
            -self.pelvis_yaw * math.cos(cycle),
            self.pelvis_roll * math.cos(cycle - 0.3 * math.pi),
        )


class LegCycle(NamedTuple):
    """A leg over its stance and over its swing, SAMPLES + 1 values each."""

    stance_pitch: Sequence[float]
    """Pitch of the standing foot, toes up [rad]."""
    pitch: Sequence[float]
    """Pitch of the swinging foot, toes up [rad]."""
    lift: Sequence[float]
    """Height of its lowest point [m]."""
    progress: Sequence[float]
    """Share of the way in the world from the last footprint to the next one."""


class GaitCycle:
    """A steady gait at one speed [m/s], in the frame of the path's pose.

    Phases are the left leg's unless noted. The standing feet are by `leads` ahead at half stance;
    `forward` is the offset of the pelvis ahead, and `height` its height, SAMPLES + 1 values over
    the phase. All lengths are in [m].
    """

    def __init__(self, style: Style, segments: Segments, speed: float) -> None:
        self._style, self._segments, self._speed = style, segments, speed
        self.stride = style.stride(speed)
        sway, *angles_deg = style.factors(speed)[-len(Swings._fields) :]
        self.swings = Swings(sway, *map(math.radians, angles_deg))
        self.stance_shares = style.stance_share(0, speed), style.stance_share(1, speed)
        self._leads = style.lead(0, speed), style.lead(1, speed)
        # between the samples, where neither leg's weight is exactly 0
        places = [self._pelvis_over_feet((i + 0.5) / SAMPLES) for i in range(SAMPLES)]
        self._forward = Fourier([x for x, _ in places])
        self._height = Fourier([z for _, z in places])
        # feet are shifted back, so that the mean place of the pelvis is the path's pose
        self.leads = self._leads[0] - self._forward.mean, self._leads[1] - self._forward.mean
        pelvis = [self._pelvis(i / SAMPLES) for i in range(SAMPLES + 1)]
        self.forward, self.height = [x for x, _ in pelvis], [z for _, z in pelvis]
        self.legs = self._leg(0), self._leg(1)

    def _pelvis(self, phase: float) -> tuple[float, float]:
        """Return the pelvis's forward place and its height [m]."""
        phase -= 0.5 / SAMPLES
        return self._forward.at(phase) - self._forward.mean, self._height.at(phase)

    def _hip(self, side: int, phase: float) -> tuple[float, float, float]:
        """Return a hip's forward and upward offset from the pelvis, and its left one from the foot.

        All offsets are in [m].
        """
        segments, (sway, yaw, roll), sign = self._segments, self.swings.pelvis(phase), 1 - 2 * side
        half = sign * segments.hips / 2
        inwards = sign * (segments.hips - segments.step_width) / 2
        return -half * math.sin(yaw), half * math.sin(roll), inwards + sway

    def _step(self, side: int, leg_phase: float, left: float = 0.0) -> tuple[float, float, float]:
        """Return the curves' foot pitch [rad], and the ankle's place before and below the hip [m].

        The hip is by `left` [m] to the left of the ankle.
        """
        segments = self._segments
        flexion, knee, ankle = self._style.angles(side, self._speed, leg_phase)
        thigh = flexion - PELVIS_TILT
        shank = thigh - knee
        down = segments.thigh * math.cos(thigh) + segments.shank * math.cos(shank)
        reach = segments.thigh * math.sin(thigh) + segments.shank * math.sin(shank)
        return shank + ankle, reach, math.sqrt(max(down * down - left * left, 0.0))

    def _pelvis_over_feet(self, phase: float) -> tuple[float, float]:
        """Return the forward place and the height of the pelvis that suit the standing legs."""
        total = forward = height = 0.0
        for side, share in enumerate(self.stance_shares):
            leg_phase = math.fmod(phase + side * self._style.offset, 1.0)
            if leg_phase >= share:
                continue
            weight = _smooth(min(leg_phase, share - leg_phase) / max(share - 0.5, 0.05))
            x, z, left = self._hip(side, phase)
            pitch, reach, drop = self._step(side, leg_phase, left)
            roll_x, roll_z = self._segments.roll(_stance_pitch(leg_phase / share, pitch))
            base = self.stride * (share / 2 - leg_phase) + self._leads[side]
            total += weight
            forward += weight * (base + roll_x - reach - x)
            height += weight * (roll_z + drop - z)
        return forward / total, height / total

    def _leg(self, side: int) -> LegCycle:
        share, parts = self.stance_shares[side], [i / SAMPLES for i in range(SAMPLES + 1)]
        stance = [_stance_pitch(u, self._step(side, share * u)[0]) for u in parts]
        phases = [share + (1.0 - share) * u for u in parts]
        pitches = [self._step(side, math.fmod(phase, 1.0))[0] for phase in phases]
        pitches = _tied(pitches, stance[-1], stance[0])
        lifts, progresses = [], []
        for leg_phase, pitch in zip(phases, pitches, strict=True):
            phase = math.fmod(leg_phase + 1.0 - side * self._style.offset, 1.0)
            hip_x, hip_z, left = self._hip(side, phase)
            _, reach, drop = self._step(side, math.fmod(leg_phase, 1.0), left)
            roll_x, roll_z = self._segments.roll(pitch)
            pelvis_x, pelvis_z = self._pelvis(phase)
            lifts.append(pelvis_z + hip_z - drop - roll_z)
            base = pelvis_x + hip_x + reach - roll_x - self.leads[side]
            progresses.append(base / self.stride + leg_phase - share / 2)
        lifts = _tied(lifts, 0.0, 0.0)
        for i, u in enumerate(parts):
            bump = 16.0 * (u * (1.0 - u)) ** 2
            least, width = _CLEARANCE * bump, 0.006 * bump
            # the larger of both, without a kink where they are about `width` apart
            root = math.sqrt((lifts[i] - least) ** 2 + width * width)
            lifts[i] = (lifts[i] + least + root) / 2
        return LegCycle(stance, pitches, lifts, _tied(progresses, 0.0, 1.0))


class GaitTable:
    """The gait at any speed: solved cycles, interpolated linearly in speed and phase."""

    def __init__(self, style: Style, segments: Segments) -> None:
        count = round((FASTEST - SLOWEST) / _SPEED_STEP) + 1
        self._cycles = [GaitCycle(style, segments, SLOWEST + i * _SPEED_STEP) for i in range(count)]
        self.offset = style.offset
        self._speed = -1.0
        self.set_speed(0.0)

    def _place(self, speed: float) -> tuple[int, float]:
        place = (min(max(speed, SLOWEST), FASTEST) - SLOWEST) / _SPEED_STEP
        i = min(int(place), len(self._cycles) - 2)
        return i, place - i

    def stride_at(self, speed: float) -> float:
        """Return the stride length [m] at a speed [m/s], without setting it."""
        i, b = self._place(speed)
        return (1.0 - b) * self._cycles[i].stride + b * self._cycles[i + 1].stride

    def set_speed(self, speed: float) -> None:
        """Set the speed [m/s], limited to the range of the solved cycles."""
        if speed == self._speed:
            return  # as on most ticks
        self._speed = speed
        i, self._share = self._place(speed)
        self._low, self._high = low, high = self._cycles[i], self._cycles[i + 1]
        self.shares = self._mixed(low.stance_shares, high.stance_shares)
        self.leads = self._mixed(low.leads, high.leads)
        (self.stride,) = self._mixed((low.stride,), (high.stride,))
        self.swings = Swings._make(self._mixed(low.swings, high.swings))

    def _mixed(self, low: Sequence[float], high: Sequence[float]) -> list[float]:
        """Return the values at the speed, from those of the cycles below and above."""
        a, b = 1.0 - self._share, self._share
        return [a * p + b * q for p, q in zip(low, high, strict=True)]

    def pelvis(self, phase: float) -> list[float]:
        """Return the pelvis's forward place and its height at the left leg's phase [m]."""
        return self._mixed(
            *([_at(c.forward, phase), _at(c.height, phase)] for c in (self._low, self._high))
        )

    def stance_pitch(self, side: int, part: float) -> float:
        """Return the pitch of a foot on the ground [rad] at a part of its stance."""
        values = ((_at(c.legs[side].stance_pitch, part),) for c in (self._low, self._high))
        return self._mixed(*values)[0]

    def swing(self, side: int, part: float) -> list[float]:
        """Return pitch, lift and progress of a foot at a part of its swing: see `LegCycle`."""
        legs = self._low.legs[side], self._high.legs[side]
        return self._mixed(*([_at(values, part) for values in leg[1:]] for leg in legs))


def _stance_pitch(part: float, pitch: float) -> float:
    """Return the foot's pitch [rad] at a part of the stance, given the `pitch` of the curves."""
    if part < _FLAT[0]:
        return max(pitch, 0.0) * _smooth((_FLAT[0] - part) / _RAMP)
    return min(pitch, 0.0) * _smooth((part - _FLAT[1]) / _RAMP)


def _tied(values: Sequence[float], first: float, last: float) -> list[float]:
    """Return the values of a swing, moved near its ends so that they begin and end as given."""
    n = len(values) - 1
    begin, end = first - values[0], last - values[-1]
    return [
        value + begin * (1.0 - _smooth(i / n / _TIED)) + end * _smooth((i / n - 1.0) / _TIED + 1.0)
        for i, value in enumerate(values)
    ]


def _smooth(u: float) -> float:
    """Return the smooth step from 0 at 0 to 1 at 1."""
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


def _at(values: Sequence[float], part: float) -> float:
    """Return a table's value, interpolated at `part` of the table in [0, 1]."""
    place = part * SAMPLES
    i = min(int(place), SAMPLES - 1)
    return values[i] + (place - i) * (values[i + 1] - values[i])
