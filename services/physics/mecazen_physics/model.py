"""Links that are lumped with their wheel, and the inertia that a motor drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from mecazen.links import RobotLink, base_link, lump, robot_links
from mecazen.robot import WHEELS, Robot

Tree = tuple[Sequence[RobotLink], Sequence[Sequence[RobotLink]]]
"""The links of a model of the robot without the base, in the order of `robot_links`; and for each
wheel the links that are lumped with it, in its frame. The second part is empty if every roller is
a link."""


def near_tree(robot: Robot) -> Tree:
    """Return the tree in which all rollers except two per wheel are lumped with their wheels.

    The separate rollers are the first and the last of each wheel, which are next to the ground
    while the wheel's angle is between 0 and a pitch. A roller turns freely about its own axis, so
    its moment of inertia about this axis does not act on the wheel: a lumped roller has none.
    """
    count = robot.rollers.count
    everything = robot_links(robot)
    end = len(WHEELS) * (1 + count)
    wheels, rollers, fixed = (
        everything[: len(WHEELS)],
        everything[len(WHEELS) : end],
        everything[end:],
    )
    lumped = []
    kept = []
    for index, wheel in enumerate(wheels):
        first, *airborne, last = rollers[index * count : (index + 1) * count]
        kept += [first, last]
        lumped.append(
            [
                replace(wheel, translation=(0.0, 0.0, 0.0)),
                *(replace(roller, moments=(*roller.moments[:2], 0.0)) for roller in airborne),
            ]
        )
    return [*wheels, *kept, *fixed], lumped


def driven_inertia(robot: Robot) -> float:
    """Return the moment of inertia that a motor accelerates when the robot drives off [kg·m²].

    The result is the inertia of the wheel with its rollers about the axle, plus that of the wheel's
    share of the robot's mass at the rim.
    """
    everything = [base_link(robot), *robot_links(robot)]
    mass = math.fsum(link.mass for link in everything)
    wheel, *rollers = (link for link in everything if link.name.startswith(WHEELS[0]))
    _, _, inertia = lump([replace(wheel, translation=(0.0, 0.0, 0.0)), *rollers])
    return float(inertia[1, 1]) + mass / len(WHEELS) * robot.wheels.radius_m**2
