"""Which rollers and which others can touch soon: nothing that touches is left out."""

from __future__ import annotations

import math

import dartpy as dart
import numpy as np
import pytest
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen_physics.contacts import ContactCandidates, Footprint
from mecazen_physics.rollers import Roller
from msgspec.structs import replace
from physics_rig import Rig

MIXED = ((4.0, 4.0, 4.0, 4.0), (-8.0, 8.0, 8.0, -8.0), (-6.0, 6.0, -6.0, 6.0), (9.0, 2.0, 2.0, 9.0))
"""Straight, strafe, spin and diagonal [rad/s]."""


class FakeRoller:
    """Stands for a roller of DART."""

    collidable = True

    def setCollidable(self, collidable: bool) -> None:  # noqa: N802 - DART's name
        self.collidable = collidable


@pytest.mark.parametrize(
    ("angle", "speed", "upright", "candidates"),
    [
        (0.0, 0.0, True, [0]),
        # half a pitch on, two of them share the ground: roller 0 has gone by, the last comes
        (math.pi / 9, 0.0, True, [0, 8]),
        (0.0, 40.0, True, [0, 1, 8]),
        (0.0, 0.0, False, list(range(9))),
    ],
)
def test_candidates_are_the_rollers_that_can_come_down_or_all_of_a_robot_that_leans(
    nexus, angle, speed, *, upright, candidates
):
    rollers = [FakeRoller() for _ in range(4 * nexus.rollers.count)]
    chosen = ContactCandidates(nexus, rollers)
    chosen.update([0.0] * 4, [0.0] * 4, 0.01, upright=True)
    chosen.update([angle] * 4, [speed] * 4, 0.01, upright=upright)
    wheel = [number for number in range(9) if rollers[number].collidable]
    assert wheel == candidates
    assert [roller.collidable for roller in rollers] == [r.collidable for r in rollers[:9]] * 4


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


def test_a_robots_footprint_holds_its_wheels_and_is_as_fast_as_its_corners(nexus):
    footprint = Footprint.of_robot(nexus.footprint, Pose2D(1.0, 2.0, 0.5), 0.3, -2.0)
    assert footprint[:6] == pytest.approx((1.0, 2.0, 0.5, 0.2, 0.2, 0.0))
    # 0.2 m/s is what it may gain in 20 ms
    assert footprint.speed == pytest.approx(0.3 + 2.0 * math.hypot(0.2, 0.2) + 0.2)


@pytest.mark.parametrize("angle_deg", [10.0, 45.0, 80.0])
def test_a_robots_footprint_holds_every_roller(robot, angle_deg):
    robot = replace(robot, rollers=replace(robot.rollers, angle_deg=angle_deg))
    length, width = robot.footprint
    centres, radii = Roller.of(robot).spheres(41)
    skeleton = Rig(robot, rollers="all").body.skeleton
    for body in skeleton.getBodyNodes()[-len(WHEELS) * robot.rollers.count :]:
        pose = body.getWorldTransform()
        x, y, _ = pose.translation()[:, None] + np.outer(pose.rotation()[:, 2], centres)
        # 1e-9: rounding
        assert (np.abs(x) + radii).max() <= length + 1e-9
        assert (np.abs(y) + radii).max() <= width + 1e-9


@pytest.mark.parametrize(
    ("tilt", "person", "isolated"),
    [
        (0.0, None, True),
        (0.04, 0.6, True),
        (0.06, None, False),
        (0.0, 0.42, False),  # 20 mm away
        (0.0, 0.44, True),
    ],
)
def test_a_robot_is_isolated_that_is_upright_and_out_of_reach_of_everything(
    nexus, tilt, person, *, isolated
):
    rig = Rig(nexus, rollers="all")
    motion = rig.body.read()
    motion.position[0] = tilt
    rig.body.write(motion)
    rig.robot.settle(0)
    if person is not None:
        rig.place_person(Pose2D(person))
    rig.robot.update_contact_candidates()
    assert rig.robot.isolated == isolated


@pytest.mark.parametrize("obstacle", [Cylinder, Box])
def test_no_roller_that_touches_anything_is_left_out(nexus, obstacle):
    size = (0.1, 0.5) if obstacle is Cylinder else (0.2, 0.2, 0.5)
    rig = Rig(nexus, rollers="all", obstacles=(obstacle(size_m=size, position_m=(0.6, 0.0)),))
    bodies = rig.body.skeleton.getBodyNodes()
    rollers = bodies[-len(WHEELS) * nexus.rollers.count :]
    left_out = 0
    for command in MIXED * 2:
        for _ in range(40):
            rig.advance(command)
            chosen = [roller.isCollidable() for roller in rollers]
            found = contacts_of(rig)
            for roller in rollers:
                roller.setCollidable(True)
            assert contacts_of(rig) == found
            for roller, collidable in zip(rollers, chosen, strict=True):
                roller.setCollidable(collidable)
            left_out += chosen.count(False)
    assert left_out > 0


def contacts_of(rig: Rig) -> int:
    """The number of contacts where everything is now."""
    simulation = rig.body.world.simulation
    group = simulation.getCollisionDetector().createCollisionGroup()
    for index in range(simulation.getNumSkeletons()):
        group.addShapeFramesOf(simulation.getSkeleton(index))
    result = dart.collision.CollisionResult()
    group.collide(simulation.getConstraintSolver().getCollisionOption(), result)
    return int(result.getNumContacts())
