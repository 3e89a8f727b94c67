"""Gaps between a robot and people and obstacles, against distances by hand."""

import math

import numpy as np
import pytest
from mecazen.config.world import Box, Cylinder
from mecazen.skeleton import INDEX, LIMBS
from mecazen_experiments.gaps import gap_to_obstacle, gap_to_person, height_of
from mecazen_tools.table import Poses
from people import HEIGHT, NEXUS, body

LENGTH, WIDTH = NEXUS.footprint
SEARCH_M = 1e-6
"""The search for the nearest point ends so close to it."""


def at(*poses):
    return Poses(*np.array(poses, dtype=float).T)


def radius(name):
    (found,) = {limb.radius for limb in LIMBS if name in (limb.begin, limb.end)}
    return found * HEIGHT


def test_in_front_of_somebody_the_gap_is_to_their_toes():
    joints = body(pose=(2.0, 0.0, math.pi))
    toe = joints[INDEX["left_foot"]]
    (found,) = gap_to_person(NEXUS, at((0.0, toe[1], 0.0)), joints[None], HEIGHT)
    assert found == pytest.approx(toe[0] - LENGTH - radius("left_foot"), abs=SEARCH_M)


def test_from_a_corner_it_is_the_straight_line_and_turning_brings_the_corner_nearer():
    cylinder = Cylinder(size_m=(0.1, 1.0), position_m=(1.0, 1.0))
    straight, aslant = gap_to_obstacle(
        NEXUS, at((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 4)), cylinder
    )
    assert straight == pytest.approx(math.hypot(1.0 - LENGTH, 1.0 - WIDTH) - 0.1, abs=1e-12)
    assert aslant == pytest.approx(math.sqrt(2.0) - LENGTH - 0.1, abs=1e-12)


def test_of_a_wall_the_gap_is_to_its_face_and_zero_where_they_touch():
    wall = Box(size_m=(4.0, 0.1, 1.0), position_m=(1.0, 0.0), yaw_deg=90.0)
    found = gap_to_obstacle(NEXUS, at((0.0, 0.3, 0.0), (1.0 - LENGTH, 0.0, 0.0)), wall)
    assert found == pytest.approx([0.95 - LENGTH, 0.0], abs=1e-12)


def test_what_is_above_the_robot_is_nowhere_near_it():
    # the feet of a body high above would be the first parts to be hit
    joints = body(pose=(0.0, 0.0, 0.0))
    joints[:, 2] += height_of(NEXUS) + 0.2
    assert math.isinf(gap_to_person(NEXUS, at((0.0, 0.0, 0.0)), joints[None], HEIGHT)[0])


def test_a_limb_that_is_level_but_for_rounding_is_as_near_as_a_level_one():
    joints = body(pose=(2.0, 0.0, math.pi))
    heel, toe = INDEX["left_heel"], INDEX["left_foot"]
    joints[heel, 2] = joints[toe, 2] = 0.0
    level, nearly = joints.copy(), joints.copy()
    nearly[heel, 2] = 5e-324
    pose = at((0.0, joints[toe, 1], 0.0))
    found = [gap_to_person(NEXUS, pose, one[None], HEIGHT)[0] for one in (level, nearly)]
    assert found[1] == pytest.approx(found[0], abs=SEARCH_M)


def test_somebody_who_is_not_there_has_no_gap():
    joints = np.full((1, 20, 3), np.nan)
    assert np.isnan(gap_to_person(NEXUS, at((0.0, 0.0, 0.0)), joints, HEIGHT)[0])
