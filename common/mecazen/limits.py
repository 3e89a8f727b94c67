"""The table of plausible numbers: their limits in messages.

A sample or a request beyond its limits is refused where its bytes are decoded, before any node
sees it. Outputs of user nodes, target and crowd are checked before they are published.
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

    quantity: str
    unit: str
    largest: float
    numbers: Callable[[Any], Sequence[float]]
    """Returns the numbers of a message."""


def _xyz(path: str) -> Callable[[Any], Sequence[float]]:
    return attrgetter(f"{path}x", f"{path}y", f"{path}z")


def _position(path: str, farthest_m: float = FARTHEST_M) -> Limit:
    return Limit("position", "m", farthest_m, _xyz(f"{path}position."))


def _twist(path: str, fastest: float = FASTEST) -> tuple[Limit, ...]:
    return (
        Limit("linear velocity", "m/s", fastest, _xyz(f"{path}linear.")),
        Limit("angular velocity", "rad/s", fastest, _xyz(f"{path}angular.")),
    )


def _each(path: str, limit: Limit) -> Limit:
    parts = attrgetter(path)
    return limit._replace(
        numbers=lambda message: [n for part in parts(message) for n in limit.numbers(part)]
    )


_JOINTS = _each("joints", Limit("joint position", "m", FARTHEST_M, _xyz("")))
_DEVIATIONS = Limit("deviation of a joint", "m", FARTHEST_M, attrgetter("std"))

BY_TYPE: Mapping[type[m.Message], tuple[Limit, ...]] = {
    m.Twist: _twist(""),
    m.Odometry: (_position("pose.pose."), *_twist("twist.twist.")),
    m.OdometryRequest: (_position("pose.", FARTHEST_START_M),),
    m.JointState: (Limit("joint velocity", "rad/s", FASTEST, attrgetter("velocity")),),
    m.Observation: (
        _each("poses", _position("pose.")),
        _each(
            "poses",
            Limit("covariance", "", FARTHEST_M**2, lambda pose: planar_entries(pose.covariance)),
        ),
    ),
    m.Skeleton: (_JOINTS, _DEVIATIONS),
    m.Skeletons: (_each("skeletons", _JOINTS), _each("skeletons", _DEVIATIONS)),
    m.People: (
        _each("persons", _position("pose.")),
        *(_each("persons", limit) for limit in _twist("twist.", FASTEST_PERSON)),
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
    keys.TARGET_CMD_VEL.key: _twist("", FASTEST_PERSON),
}
"""Limits of keys that differ from the limits of their message type."""


def refuse_implausible(key: str, message: m.Message) -> None:
    """Check a message that came on `key`, without a robot's namespace.

    Raises:
        RefusedError: A number is beyond its limit.
    """
    for quantity, unit, largest, numbers in BY_KEY.get(key) or BY_TYPE.get(type(message), ()):
        values = numbers(message)
        # if the norm is within the limit, so is each number, and none is NaN; faster than a loop
        if not math.hypot(*values) <= largest:
            for value in values:
                if not abs(value) <= largest:
                    limit = f"{largest:g} {unit}".rstrip()
                    raise RefusedError(f"{quantity} {value} is out of range, at most {limit}")
