"""Gains of an ideal robot without slip, whose rollers are not at 45° while they roll."""

from __future__ import annotations

import math

import numpy as np
from mecazen.portable import legendre, tan
from mecazen.robot import Robot
from mecazen.rollers import Roller


def lateral_gain(robot: Robot) -> float:
    """Return the mean of v_y over its ideal value for pure lateral motion without slip.

    A roller resists only along its axis, so the wheel's contact point has no velocity along the
    horizontal part of that axis. When the wheel has turned its roller by θ from the bottom, the
    axis (±sin γ, cos γ, 0) has become (±sin γ·cos θ, cos γ, ∓sin γ·sin θ), so its effective angle
    has tan γ' = tan γ·cos θ and

        (v_x - ω·R)·tan γ·cos θ ± v_y = 0.

    The ideal equations have θ = 0. With v_x = 0 the gain is cos θ: it is 1 in a roller's
    middle, and its mean over the arc |θ| ≤ α = π/N is sin(α)/α.
    """
    arc = Roller.from_robot(robot).half_arc
    return float(np.sin(arc) / arc)


def yaw_gain(robot: Robot) -> float:
    """Return the mean of the yaw rate over its ideal value for turning on the spot.

    The derivation is that of `lateral_gain`, with the velocity of a wheel's centre (∓l_y, ±l_x)·ω_z
    and the contact's offset along the axle, e = d·tan θ/tan γ. The gain for which a wheel would not
    slip is

        (l_y + l_x·cot γ)/(l_y + e + l_x·cot γ/cos θ).

    Two diagonal wheels have their contacts farther out by e, the two others farther in by e, so
    their gains differ and one pair slips. On an axle that swings about its middle, wheel loads are
    inversely proportional to the distances of the contacts from the middle, 1/(l_y ± e). The pair
    whose grip has the larger moment, load times lever, prevails; in the arrangement X that is the
    inner pair. This gain holds for wheels whose rollers are in the same phase, as at the start; in
    other phases it is up to 3 % less.
    """
    roller = Roller.from_robot(robot)
    # the gain has a kink at θ = 0, and is symmetric: integrate one half
    nodes, weights = legendre(16)
    theta = roller.half_arc * (nodes + 1.0) / 2.0
    offset = roller.axis_distance * tan(theta) / math.tan(roller.angle)
    distances = robot.half_track + np.stack([offset, -offset])
    levers = distances + robot.half_wheelbase * robot.cross_gain / np.cos(theta)
    prevails = np.argmax(np.abs(levers) / distances, axis=0)
    gain = robot.lever / np.take_along_axis(levers, prevails[None], axis=0)[0]
    return math.fsum(weights * gain) / 2.0
