"""The walking person: each foot is put down at its standing place, and stays there."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np
from mecazen.config.people import Body
from mecazen.geometry import Pose2D, Twist2D, wrap
from numpy.random import PCG64, Generator

from mecazen_people.body.cycle import SLOWEST, GaitTable
from mecazen_people.body.gait import Style, normal_gait
from mecazen_people.body.posture import Point, Posture, Segments, sagittal_angles
from mecazen_people.body.recording import height_of, read_recording
from mecazen_people.motion import PersonMotion

_LAG_S = 0.08  # each of two lags in series, for the twist and for starts and stops
_STILL_M_S, _STILL_RAD_S = 0.01, 0.02  # below both the person stands
_START_PHASE = 0.75  # of the leg that steps first; the other foot is under the body
_PERIOD_S = (0.6, 1.2)  # shortest period; period of the steps that end a walk
_TURN_RAD, _ASIDE_M, _BACK_M = 0.8, 0.5, 0.6  # largest turn and steps aside and back in a stride
_HOME = (0.03, 0.1)  # within these [m, rad] a foot is where it should stand
_ASTRAY = (0.1, 0.35)  # beyond these a standing person takes a step
_STEP_M = 0.04  # height of steps that are not forward
_REACH = 0.9999  # largest distance of hip and ankle, as a share of the leg's length
# a leg that passes through its straight posture bends too fast: after a change of the twist by
# _SOFT_M_S or more, the pelvis stays lower by _SOFT_M; this offset decays with _SETTLE_S
_SOFT_M, _SOFT_M_S, _SETTLE_S = 0.02, 0.4, 0.3
_HURRY_M = (0.03, 0.02)  # drop of the pelvis that hurries steps; further drop that doubles the rate
_MOST_HURRY = 2.0
_MOST_SD = 3.0  # largest deviation of a stride, in standard deviations
_LOWEST = 0.7  # share of the standing height, below which a foot slips instead
_STEP_S = 0.04  # longest step; longer times are divided
_GAP_S = 1.0  # longest time over which a walk continues


@dataclass
class _Leg:
    base: Pose2D
    """The point below the ankle of the flat foot, in the world."""
    left: Pose2D
    """Pose at which the swing began."""
    swings: bool = False
    lifted: float = 0.0
    """Phase at which the swing began."""
    pitch: float = 0.0
    lift: float = 0.0


class WalkingPerson:
    """A body on its path, step by step.

    The path's pose is the body's frame: x forward, y left. In the middle of its stance a foot is
    below this frame. So a foot is put down where the frame will be after half the stance if the
    twist stays constant (M. H. Raibert, Legged Robots That Balance, 1986, p. 46). The exponential
    map of SE(2) predicts this place for any twist, also sideways or on the spot. The foot stays
    there while it rolls from heel to ball. In swing it moves to the next place with the progress,
    the lift and the pitch of the solved cycle. A lag of the twist keeps the next place continuous.
    """

    def __init__(self, body: Body) -> None:
        height = height_of(body)
        self.segments = Segments.from_height(height)
        gait = normal_gait()
        if body.motion_file is not None:
            gait = read_recording(body.motion_file, self.segments)
        self.style = Style(body, height, gait)
        self._gait = GaitTable(self.style, self.segments)
        self._stride_cv = body.stride_cv
        self.reset(PersonMotion(Pose2D()))

    def twin(self) -> WalkingPerson:
        """Return another walker with the same body, which reuses the solved gait."""
        twin = copy(self)
        twin._gait = copy(self._gait)
        twin.reset(PersonMotion(Pose2D()))
        return twin

    def reset(self, motion: PersonMotion, *seed: int) -> Posture:
        """Stand at the pose of `motion` and return the posture; `seed` draws the stride times."""
        self._chance = Generator(PCG64(seed or 0))
        return self._stand(motion)

    def _stand(self, motion: PersonMotion) -> Posture:
        self._stretch = 1.0
        self._pose = motion.pose
        self._phase = 0.0
        self._walks = False
        self._pulled = self._unsteady = 0.0
        self._lags = [[0.0] * 4, [0.0] * 4]
        self._frame()
        places = [motion.pose.compose(self._nominal(side, 0.0)) for side in (0, 1)]
        self._legs = [_Leg(place, place) for place in places]
        return self._posture()

    def follow(self, motion: PersonMotion, dt_s: float) -> Posture:
        """Advance by any time `dt_s` [s] to `motion` and return the posture there.

        After a gap of more than 1 s, or a step back in time, the body stands at the new pose.
        """
        if not 0.0 <= dt_s <= _GAP_S:
            return self._stand(motion)
        steps = max(math.ceil(dt_s / _STEP_S), 1)
        for left in range(steps - 1, 0, -1):
            pose = motion.pose.integrate(motion.twist, -left * dt_s / steps)
            self.step(PersonMotion(pose, motion.twist), dt_s / steps)
        return self.step(motion, dt_s / steps)

    def step(self, motion: PersonMotion, dt_s: float) -> Posture:
        """Advance by a short time `dt_s` [s] to `motion` and return the posture there."""
        self._pose = motion.pose
        x, y, yaw = motion.twist
        speed = math.hypot(x, y)
        moves = speed > _STILL_M_S or abs(yaw) > _STILL_RAD_S
        self._start_or_stop(motion.twist, moves)
        keep = math.exp(-dt_s / _LAG_S)
        inputs = [x, y, yaw, float(self._walks)]
        for lag in self._lags:
            for i, value in enumerate(inputs):
                lag[i] = value + keep * (lag[i] - value)
            inputs = lag
        first, second = self._lags
        change = max(abs(p - q) for p, q in zip(first, second, strict=True))
        self._unsteady = max(change, self._unsteady * math.exp(-dt_s / _SETTLE_S))
        if self._walks:
            period = _PERIOD_S[1]
            if moves:
                period = _period(motion.twist, self._gait.stride_at(speed))
            hurry = 1.0 + max(self._pulled - _HURRY_M[0], 0.0) / _HURRY_M[1]
            phase = self._phase + min(hurry, _MOST_HURRY) * dt_s / (period * self._stretch)
            self._phase = math.fmod(phase, 1.0)
            if phase >= 1.0 and self._stride_cv:
                drawn = float(self._chance.standard_normal())
                drawn = min(max(drawn, -_MOST_SD), _MOST_SD)
                self._stretch = 1.0 + self._stride_cv * drawn
        self._frame()
        for side in (0, 1):
            self._move(side)
        return self._posture()

    def _phase_of(self, side: int) -> float:
        return math.fmod(self._phase + side * self._gait.offset, 1.0)

    def _frame(self) -> None:
        """Set the values of a step that depend on the twist."""
        x, y, yaw, self._activity = self._lags[1]
        speed = math.hypot(x, y)
        self._gait.set_speed(speed)
        self._twist = Twist2D(x, y, yaw)
        self._period = _period(self._twist, self._gait.stride) * self._stretch
        self._ahead = min(max(x, -speed), speed) / max(speed, SLOWEST)
        """1 when walking forward, 0 when standing, turning or walking sideways."""

    def _start_or_stop(self, twist: Twist2D, moves: bool) -> None:
        if self._walks and (moves or self._legs[0].swings or self._legs[1].swings):
            return
        offs = [self._off(side) for side in (0, 1)]
        if self._walks:
            self._walks = not all(d < _HOME[0] and turn < _HOME[1] for d, turn in offs)
        elif moves or any(d > _ASTRAY[0] or turn > _ASTRAY[1] for d, turn in offs):
            self._walks = True
            if self._activity > 0.01:
                return  # still in the middle of a cycle
            aside = twist.y + 0.3 * twist.yaw
            first = 0 if aside > 0.02 or (not moves and offs[0] > offs[1]) else 1
            self._phase = math.fmod(_START_PHASE + 1.0 - first * self._gait.offset, 1.0)
            self._lift_off(first, _START_PHASE)

    def _off(self, side: int) -> tuple[float, float]:
        """Return how far a foot is from its standing place: distance [m] and turn [rad]."""
        x, y, yaw = self._pose.between(self._legs[side].base)
        home = self._nominal(side, 0.0)
        return math.hypot(x - home.x, y - home.y), abs(wrap(yaw))

    def _nominal(self, side: int, cycles: float) -> Pose2D:
        """Return the place, in the path's frame, of a foot that this frame passes in `cycles`."""
        aside = self.segments.step_width / 2 + 0.25 * abs(self._twist.y) * self._period
        return (
            Pose2D()
            .integrate(self._twist, self._period * cycles)
            .compose(Pose2D(self._gait.leads[side] * self._ahead, aside * (1 - 2 * side)))
        )

    def _lift_off(self, side: int, phase: float) -> None:
        leg = self._legs[side]
        leg.swings, leg.lifted, leg.left = True, phase, leg.base

    def _shown(self) -> float:
        """Return the share of the forward walk's cycle in the motion."""
        return self._activity * max(self._ahead, 0.0)

    def _move(self, side: int) -> None:
        """Move a foot to its place at the phase."""
        leg, gait, phase = self._legs[side], self._gait, self._phase_of(side)
        share = gait.shares[side]
        if leg.swings and phase < leg.lifted:
            leg.swings = False
            leg.base = self._pose.compose(self._nominal(side, share / 2 - phase))
        elif not leg.swings and phase >= share:
            self._lift_off(side, share)
        if not leg.swings:
            leg.pitch, leg.lift = self._shown() * gait.stance_pitch(side, phase / share), 0.0
            return
        part = (phase - leg.lifted) / (1.0 - leg.lifted)
        pitch, lift, progress = gait.swing(side, part)
        x, y, yaw = leg.left
        goal = self._pose.compose(self._nominal(side, share / 2 + 1.0 - phase))
        leg.base = Pose2D(
            x + progress * (goal.x - x),
            y + progress * (goal.y - y),
            yaw + progress * wrap(goal.yaw - yaw),
        )
        shown, bump = self._shown(), 16.0 * _STEP_M * (part * (1.0 - part)) ** 2
        leg.pitch, leg.lift = shown * pitch, bump + shown * (lift - bump)

    def _posture(self) -> Posture:
        segments, activity = self.segments, self._activity
        swings, cycle = self._gait.swings, math.tau * self._phase
        swing = activity * self._ahead
        sway, turn, roll = swings.pelvis(self._phase)
        ahead, height = self._gait.pelvis(self._phase)
        x, y, heading = self._pose.compose(Pose2D(swing * ahead, activity * sway))
        yaw = heading + swing * turn
        c, s = math.cos(yaw), math.sin(yaw)
        half, roll = segments.hips / 2, activity * roll
        out, up = half * math.cos(roll), half * math.sin(roll)
        height = segments.standing + activity * (height - segments.standing)
        feet = [self._foot(leg) for leg in self._legs]
        hips = [(x - sign * out * s, y + sign * out * c, sign * up) for sign in (1, -1)]
        longest = _REACH * (segments.thigh + segments.shank)
        free = height
        width = _SOFT_M * min(self._unsteady / _SOFT_M_S, 1.0)
        for (hx, hy, hz), (ankle, _, _) in zip(hips, feet, strict=True):
            room = longest * longest - (ankle[0] - hx) ** 2 - (ankle[1] - hy) ** 2
            above = height - (ankle[2] + math.sqrt(max(room, 0.0)) - hz)
            height -= (above + math.sqrt(above * above + width * width)) / 2
        self._pulled = free - height
        height = max(height, _LOWEST * segments.standing)
        neck = height + segments.trunk
        joints: list[Point] = [
            (x, y, height),
            (x, y, height + segments.trunk / 2),
            (x, y, neck),
            (x, y, neck + segments.head),
        ]
        trunk = heading + swing * swings.trunk_yaw * math.cos(cycle)
        for side, (hip, foot) in enumerate(zip(hips, feet, strict=True)):
            arm = -swing * swings.arm * math.cos(cycle + math.pi * side)
            largest = abs(swing) * swings.arm
            joints += self._arm((x, y, neck), trunk, 1 - 2 * side, arm, arm + largest)
            hip = (hip[0], hip[1], height + hip[2])  # noqa: PLW2901
            forward = yaw + 0.5 * wrap(self._legs[side].base.yaw - yaw)
            joints += [hip, *self._leg(hip, foot[0], forward), *foot[1:]]
        return Posture(
            np.array(joints),
            sagittal_angles(joints),
            (self._phase_of(0), self._phase_of(1)),
            (not self._legs[0].swings, not self._legs[1].swings),
        )

    def _foot(self, leg: _Leg) -> tuple[Point, Point, Point]:
        """Return ankle, heel and ball of a foot in the world."""
        segments, (x, y, yaw), lift = self.segments, leg.base, leg.lift
        dx, dy = math.cos(yaw), math.sin(yaw)
        forward, up = segments.roll(leg.pitch)
        length = segments.heel + segments.ball
        along, rise = length * math.cos(leg.pitch), length * math.sin(leg.pitch)
        if leg.pitch >= 0.0:
            heel, ball = (-segments.heel, lift), (along - segments.heel, lift + rise)
        else:
            heel, ball = (segments.ball - along, lift - rise), (segments.ball, lift)
        return (
            (x + forward * dx, y + forward * dy, up + lift),
            (x + heel[0] * dx, y + heel[0] * dy, heel[1]),
            (x + ball[0] * dx, y + ball[0] * dy, ball[1]),
        )

    def _leg(self, hip: Point, ankle: Point, forward: float) -> tuple[Point, Point]:
        """Return the knee, which points to the yaw `forward`, and the ankle, within reach."""
        thigh, shank = self.segments.thigh, self.segments.shank
        d = [a - h for a, h in zip(ankle, hip, strict=True)]
        distance = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        longest = _REACH * (thigh + shank)
        u = [a / distance for a in d]
        if distance > longest:
            distance = longest
            ankle = (hip[0] + u[0] * distance, hip[1] + u[1] * distance, hip[2] + u[2] * distance)
        along = (thigh * thigh - shank * shank + distance * distance) / (2.0 * distance)
        aside = math.sqrt(max(thigh * thigh - along * along, 0.0))
        fx, fy = math.cos(forward), math.sin(forward)
        share = fx * u[0] + fy * u[1]
        nx, ny, nz = fx - share * u[0], fy - share * u[1], -share * u[2]
        aside /= math.sqrt(nx * nx + ny * ny + nz * nz)
        x, y, z = (h + along * a + aside * n for h, a, n in zip(hip, u, (nx, ny, nz), strict=True))
        return (x, y, z), ankle

    def _arm(
        self, neck: Point, yaw: float, sign: int, upper: float, bend: float
    ) -> tuple[Point, Point, Point]:
        """Return shoulder, elbow and wrist of an arm that is raised forward by `upper` [rad].

        The elbow bends by 0.25 rad and a share of `bend` [rad], more as the arm swings forward.
        """
        segments = self.segments
        dx, dy = math.cos(yaw), math.sin(yaw)
        aside = sign * segments.shoulders / 2
        x, y, z = neck[0] - aside * dy, neck[1] + aside * dx, neck[2]
        lower = upper + 0.25 + 0.4 * bend
        points = [(x, y, z)]
        for length, angle in ((segments.upper_arm, upper), (segments.forearm, lower)):
            reach = length * math.sin(angle)
            x, y, z = x + reach * dx, y + reach * dy, z - length * math.cos(angle)
            points.append((x, y, z))
        return points[0], points[1], points[2]


def _period(twist: Twist2D, stride: float) -> float:
    """Return the period of a stride [s]; shorter if such strides turn or step too far."""
    x, y, yaw = twist
    period = stride / max(math.hypot(x, y), SLOWEST)
    for rate, largest in ((abs(yaw), _TURN_RAD), (abs(y), _ASIDE_M), (-x, _BACK_M)):
        if rate * period > largest:
            period = largest / rate
    return max(period, _PERIOD_S[0])
