"""A recorded track: timed positions become a smooth motion with a heading."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are used: most paths need none
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen.portable import Floats, arctan2

from mecazen_people.motion import PersonMotion, PersonPath

STANDING_M_S, WALKING_M_S = 0.2, 0.3
"""Below the first speed the heading is held, above the second it follows the motion, between them
partly."""
MAX_YAW_RATE = 3.0
"""Maximum yaw rate of a walking person [rad/s]."""

_STEP_S = 0.04  # between knots of the motion
_CORRECTION = 5.0  # gain on the lag of the heading [1/s]


def recorded_walk(track: Floats, smoothing: float) -> PersonPath:
    """Return the motion of a recorded track, from time 0 on, in the frame of the recording.

    Cubics in time interpolate the samples: the person stands still between equal samples and
    walks evenly over a gap. The position is the moving average of that curve, since samples of
    tracked people jump by decimetres. The first and the last sample keep their place.

    The heading is that of the track, or else the direction of motion, which is held while the
    person stands, with a limited rate: a person who stops and leaves in another direction turns
    while setting off, and the twist has a lateral component until then. The heading of a track
    without motion is 0.

    Args:
        track: Time [s], x and y [m] of each sample (n, 3), or also the heading [rad] (n, 4).
        smoothing: Window of the moving average [s].
    """
    times, places = track[:, 0] - track[0, 0], track[:, 1:]
    end = float(times[-1])
    # extended by point reflection about both ends, so that the average keeps the ends
    times = np.concatenate((-times[:0:-1], times, 2 * end - times[-2::-1]))
    before, after = 2 * places[0] - places[:0:-1], 2 * places[-1] - places[-2::-1]
    places = np.concatenate((before, places, after))
    curve = scipy.interpolate.CubicHermiteSpline(times, places, limited_slopes(times, places))
    area, window = curve.antiderivative(), min(smoothing, end)
    knots = np.linspace(0.0, end, math.ceil(end / _STEP_S) + 1)
    start, stop = knots - window / 2, knots + window / 2
    means = (area(stop) - area(start)) / window
    velocities = ((curve(stop) - curve(start)) / window)[:, :2]
    means, turns = means[:, :2], means[:, 2:]
    speeds = np.hypot(*velocities.T)
    headings = turns[:, 0] if turns.size else _headings(velocities, speeds, float(knots[1]))
    distances = scipy.integrate.cumulative_trapezoid(speeds, knots, initial=0.0)
    values = np.column_stack((means, headings, distances))
    slopes = np.column_stack((velocities, limited_slopes(knots, headings), speeds))
    motion = scipy.interpolate.CubicHermiteSpline(knots, values, slopes)

    def at(t: float) -> PersonMotion:
        inside = min(max(t, 0.0), end)
        x, y, yaw, distance = motion(inside).tolist()
        pose = Pose2D(x, y, wrap(yaw))
        if t != inside:
            return PersonMotion(pose, Twist2D(), distance)
        dx, dy, yaw_rate, _ = motion(inside, 1).tolist()
        return PersonMotion(pose, Twist2D(*rotate(dx, dy, -yaw), yaw_rate), distance)

    return PersonPath(end, at)


def limited_slopes(knots: Floats, values: Floats) -> Floats:
    """Return slopes that prevent overshoot: the curve rests between repeated points.

    The slope at an inner knot is that of the parabola through it and its neighbours, limited to
    three times the shorter secant; at the ends it is the secant. With one coordinate the curve is
    monotonic where its values are: J. M. Hyman, Accurate monotonicity preserving cubic
    interpolation, SIAM J. Sci. Stat. Comput. 4 (1983). The limit is on the length of the vector, so
    the curve does not depend on the frame. Values are (n) or (n, coordinates), as is the result.
    """
    points = values.reshape(len(knots), -1)
    widths = np.diff(knots)[:, None]
    secants = np.diff(points, axis=0) / widths
    lengths = np.sqrt((secants * secants).sum(axis=1))
    limits = 3.0 * np.minimum(lengths[:-1], lengths[1:])
    slopes = (widths[1:] * secants[:-1] + widths[:-1] * secants[1:]) / (widths[:-1] + widths[1:])
    sizes = np.sqrt((slopes * slopes).sum(axis=1))
    slopes *= np.minimum(1.0, limits / np.where(sizes > 0.0, sizes, 1.0))[:, None]
    return np.concatenate((secants[:1], slopes, secants[-1:])).reshape(values.shape)


def _headings(velocities: Floats, speeds: Floats, step: float) -> Floats:
    """Return the headings (n) [rad], not wrapped, of velocities (n, 2) that are `step` [s] apart.

    The heading follows the direction of motion, with a proportional gain on its lag, weighted by
    the share of walking and limited to `MAX_YAW_RATE`.
    """
    directions = arctan2(velocities[:, 1], velocities[:, 0]).tolist()
    parts = ((speeds - STANDING_M_S) / (WALKING_M_S - STANDING_M_S)).clip(0.0, 1.0)
    shares = (parts * parts * (3.0 - 2.0 * parts)).tolist()  # 0 standing, 1 walking
    headings = [next((d for d, share in zip(directions, shares, strict=True) if share > 0.0), 0.0)]
    limit = MAX_YAW_RATE * step
    for (d0, d1), (share0, share1) in zip(pairwise(directions), pairwise(shares), strict=True):
        lag = wrap(d0 - headings[-1])
        turn = wrap(d1 - d0) + _CORRECTION * step * lag
        headings.append(headings[-1] + min(share0, share1) * min(max(turn, -limit), limit))
    return np.array(headings)
