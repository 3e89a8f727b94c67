"""The verdict on a plan: the priority that it gives up, and the reason."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from mecazen.arrays import to_rectangle
from mecazen.geometry import Standoff
from mecazen.portable import Floats

from mecazen_follower.planner.costs import Costs, Extents, Situation
from mecazen_follower.planner.field import Shadows
from mecazen_follower.planner.modes import Prediction
from mecazen_follower.planner.rollout import Rollout

GIVEN_UP_M, GIVEN_UP_RAD = 0.3, math.radians(30.0)
"""Errors of distance and angle at the end of a plan from which on they count as given up."""
STILL_M = 0.15
"""A robot that moves less than this in a whole plan is waiting [m]."""


class Plan(NamedTuple):
    """The planner's state: open, avoiding, gave_up_<priority> or waiting; and the reason."""

    state: str
    reason: str = ""


OPEN = Plan("open")


def free(
    ways: Rollout,
    standing: Floats,
    movers: Floats,
    body: Extents,
    person: Prediction,
    shadows: Shadows,
    clearance: float,
    dt: float,
) -> str:
    """Return what blocks the first path or hides the person from it; "" if nothing does.

    Distances of points are from the robot's rectangle, those of walkers from its circumcircle.
    """
    x, y, c, s = (values[:, :1] for values in ways[:4])
    dx, dy = standing[:, 0] - x, standing[:, 1] - y
    gaps = to_rectangle(c * dx + s * dy, c * dy - s * dx, (body.length, body.width))
    gap = gaps.min(axis=1, initial=math.inf)
    reach = math.hypot(body.length, body.width) + body.person
    passing = np.hypot(movers[..., 0] - x, movers[..., 1] - y) - reach
    crossing = passing.min(axis=1, initial=math.inf)
    off_x, off_y = x - person.poses[:, :1], y - person.poses[:, 1:2]
    hidden = shadows.hide(off_x, off_y, np.hypot(off_x, off_y))[:, 0]
    for bad, reason in (
        (gap < clearance, "an obstacle is in the way"),
        (crossing < clearance, "somebody comes across"),
        (hidden, "the person would be hidden"),
    ):
        if bad.any():
            return f"{reason} in {dt * (int(np.argmax(bad)) + 1):.1f} s"
    return ""


def verdict(
    way: Rollout, scene: Situation, costs: Costs, standoff: Standoff, obstacle: str, last: str
) -> Plan:
    """Return the state of a path that was chosen because of an obstacle.

    For hysteresis, a state of the last plan remains until its error falls to half the limit.
    """
    x, y = way.x - scene.person[:, :1], way.y - scene.person[:, 1:2]
    distance = np.hypot(x, y)
    yaw = float(scene.person[-1, 2])
    bearing = math.remainder(
        math.atan2(float(y[-1, 0]), float(x[-1, 0])) - yaw - standoff.bearing, math.tau
    )
    heading = math.atan2(float(way.s[-1, 0]), float(way.c[-1, 0]))
    off = math.remainder(heading - yaw - standoff.heading, math.tau)
    error = abs(float(distance[-1, 0]) - standoff.distance)
    moved = math.hypot(float(way.x[-1, 0]), float(way.y[-1, 0]))
    if moved < STILL_M * (2 if last == "waiting" else 1) and error > GIVEN_UP_M:
        return Plan("waiting", obstacle)
    lost = {
        "distance": error / GIVEN_UP_M,
        "visibility": 2.0 * float(costs.unseen(way, scene, x, y, distance).mean()),
        "bearing": abs(bearing) / GIVEN_UP_RAD,
        "heading": abs(off) / GIVEN_UP_RAD,
    }
    for name in costs.weights:  # highest priority first
        state = f"gave_up_{name}"
        if lost[name] > (0.5 if last == state else 1.0):
            return Plan(state, obstacle)
    return Plan("avoiding", obstacle)
