"""The table of plausible numbers: their limits in messages that come from outside.

A sample or a request beyond its limits is refused where its bytes are decoded, before any node
sees it. Messages within a process are not decoded: there only those of user nodes are checked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

from mecazen import keys
from mecazen import messages as m
from mecazen.messages import planar_entries
from mecazen.wire import RefusedError

FARTHEST_M = 1e6
"""The largest coordinate: beyond it the arithmetic of poses loses millimetres."""
FARTHEST_START_M = 1e5
"""The largest coordinate that odometry can be set to: it leaves room to drive on."""
FASTEST = 1e6
"""The largest component of a velocity of the robot or its joints [m/s, rad/s]."""
FASTEST_PERSON = 20.0
"""The largest component of a velocity of a person [m/s, rad/s]: `people.FASTEST_M_S`, with the
largest oscillation of the gait."""
FASTEST_PUSH = 10.0
"""The largest component of the velocity with which a person pushes robots [m/s, rad/s]."""


class Limit(NamedTuple):
    """The largest magnitude that some numbers of a message may have."""

    what: str
    unit: str
    most: float
    part: Callable[[Any], Any]
    """Returns the part of a message that holds the numbers ..."""
    numbers: Callable[[Any], Sequence[float]]
    """... and the numbers from that part."""


def _xyz(vector: m.Vector3 | m.Point) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _position(path: str, farthest_m: float = FARTHEST_M) -> Limit:
    return Limit("position", "m", farthest_m, attrgetter(f"{path}position"), _xyz)


def _twist(path: str, linear: float = FASTEST, angular: float = FASTEST) -> tuple[Limit, ...]:
    return (
        Limit("linear velocity", "m/s", linear, attrgetter(f"{path}linear"), _xyz),
        Limit("angular velocity", "rad/s", angular, attrgetter(f"{path}angular"), _xyz),
    )


def _each(path: str, limit: Limit) -> Limit:
    """Return the limit of a message whose parts at `path` all have that limit."""
    return limit._replace(
        part=attrgetter(path),
        numbers=lambda parts: [n for part in parts for n in limit.numbers(limit.part(part))],
    )


_JOINTS = _each("joints", Limit("joint position", "m", FARTHEST_M, lambda joint: joint, _xyz))
_DEVIATIONS = Limit("deviation of a joint", "m", FARTHEST_M, attrgetter("std"), tuple)

BY_TYPE: Mapping[type[m.Message], tuple[Limit, ...]] = {
    m.Twist: _twist(""),
    m.Odometry: (_position("pose.pose."), *_twist("twist.twist.")),
    m.OdometryRequest: (_position("pose.", FARTHEST_START_M),),
    m.JointState: (Limit("joint velocity", "rad/s", FASTEST, attrgetter("velocity"), tuple),),
    m.Observation: (
        _each("poses", _position("pose.")),
        _each(
            "poses",
            Limit("covariance", "", FARTHEST_M**2, attrgetter("covariance"), planar_entries),
        ),
    ),
    m.Skeleton: (_JOINTS, _DEVIATIONS),
    m.Skeletons: (_each("skeletons", _JOINTS), _each("skeletons", _DEVIATIONS)),
    m.People: (
        _each("persons", _position("pose.")),
        *(_each("persons", of) for of in _twist("twist.", FASTEST_PERSON, FASTEST_PERSON)),
        _each("persons", _JOINTS),
        _each("robots", _position("pose.")),
    ),
    m.FollowerState: (
        _each("estimate", _position("pose.pose.")),
        _each("goal", _position("")),
    ),
}
"""The limits of a message, whichever key carries it; a quaternion may have any length."""

BY_KEY: Mapping[str, tuple[Limit, ...]] = {
    keys.TARGET_CMD_VEL.key: _twist("", FASTEST_PERSON, FASTEST_PERSON),
}
"""Limits of keys that differ from the limits of their message type."""


def refuse_implausible(key: str, message: m.Message) -> None:
    """Check a message that came on `key`, without a robot's namespace.

    Raises:
        RefusedError: A number is beyond its limit.
    """
    for what, unit, most, part, numbers in BY_KEY.get(key) or BY_TYPE.get(type(message), ()):
        values = numbers(part(message))
        # if the norm is within the limit, so is each number, and none is NaN; faster than a loop
        if not math.hypot(*values) <= most:
            for value in values:
                if not abs(value) <= most:
                    at_most = f"{most:g} {unit}".rstrip()
                    raise RefusedError(f"{what} {value} is out of range, at most {at_most}")
