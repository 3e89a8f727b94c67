"""Footprints: which two bodies can touch soon."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mecazen.robot import WHEELS
from mecazen.rollers import Roller
from mecazen_physics.footprint import Footprint
from msgspec.structs import replace
from physics_rig import Rig

STANDING = Footprint(0.0, 0.0, half_length=0.2, half_width=0.1)


@pytest.mark.parametrize(
    ("one", "other", "gap"),
    [
        (STANDING, Footprint(0.6, 0.0, rim=0.2), 0.2),
        (STANDING, Footprint(0.0, -0.6, rim=0.2), 0.3),
        (STANDING._replace(yaw=math.pi / 2), Footprint(0.6, 0.0, rim=0.2), 0.3),
        # off its corner
        (STANDING, Footprint(0.5, 0.5, rim=0.2), 0.3),
        # a long wall along y
        (STANDING, Footprint(1.0, 2.0, math.pi / 2, 5.0, 0.1), 0.7),
        (STANDING, STANDING._replace(x=1.0), 0.6),
        # corner before corner: a bound by the circle round one of them
        (STANDING, STANDING._replace(x=1.0, y=1.0), math.hypot(0.8, 0.9) - math.hypot(0.2, 0.1)),
        (STANDING, STANDING._replace(x=1.0, yaw=math.pi / 4), 0.8 - 0.3 / math.sqrt(2)),
        (STANDING, Footprint(0.1, 0.0, rim=0.2), -0.2),
    ],
)
def test_the_gap_between_two_is_known_by_their_axes_and_circles(one, other, gap):
    assert one.gap(other) == pytest.approx(gap)
    assert other.gap(one) == pytest.approx(gap)


def test_two_may_touch_that_can_reach_each_other_within_the_horizon():
    person = Footprint(0.5, 0.0, rim=0.2)
    assert not STANDING.may_touch(person)
    assert not STANDING._replace(speed=1.0).may_touch(person._replace(speed=2.9))  # 20 + 78 mm
    assert STANDING._replace(speed=1.0).may_touch(person._replace(speed=3.1))  # 20 + 82 mm
    assert STANDING._replace(speed=1.0).may_touch(person._replace(speed=2.0), margin=1.5)


@pytest.mark.parametrize("angle_deg", [10.0, 45.0, 80.0])
def test_a_robots_footprint_holds_every_roller(robot, angle_deg):
    robot = replace(robot, rollers=replace(robot.rollers, angle_deg=angle_deg))
    length, width = robot.footprint
    centres, radii = Roller.from_robot(robot).spheres(41)
    skeleton = Rig(robot).body.skeleton
    for body in skeleton.getBodyNodes()[-len(WHEELS) * robot.rollers.count :]:
        pose = body.getWorldTransform()
        x, y, _ = pose.translation()[:, None] + np.outer(pose.rotation()[:, 2], centres)
        # 1e-9: rounding
        assert (np.abs(x) + radii).max() <= length + 1e-9
        assert (np.abs(y) + radii).max() <= width + 1e-9
