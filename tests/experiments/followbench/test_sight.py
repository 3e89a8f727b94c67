"""The lidar of Follow-Bench, and who is visible."""

import math

import numpy as np
import pytest
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.sight import ANGLES, APART, BEAMS, KnownArea, scan

NOBODY = np.empty((0, 2))
NO_BOX = np.empty((0, 5))
ORIGIN = Pose2D()
WALL = np.array([[3.0, 0.0, 0.0, 0.2, 4.0]])
"""A wall across the way, 2.9 m ahead; beams pass by its ends."""


def sees(person, boxes=NO_BOX, others=NOBODY, pose=ORIGIN):
    people = np.vstack((np.array([person]), others))
    area = KnownArea()
    area.update(scan(pose, people, boxes))
    return bool(area.sees(pose, people)[0])


def test_beams_that_meet_nothing_are_5_m_long():
    assert np.array_equal(scan(Pose2D(1.0, 2.0, 0.5), NOBODY, NO_BOX), np.full(BEAMS, 5.0))


def beam(bearing_deg, ranges):
    """Return the range of the beam that is nearest to a bearing."""
    return ranges[np.abs(ANGLES - math.radians(bearing_deg)).argmin()]


def test_beams_go_counter_clockwise_from_behind_and_the_last_is_the_first():
    person = np.array([[0.0, 2.0]])  # to the left of a robot that looks along x

    ranges = scan(Pose2D(), person, NO_BOX)
    turned = scan(Pose2D(yaw=math.pi / 2), person, NO_BOX)
    away = scan(Pose2D(yaw=-math.pi / 2), person, NO_BOX)

    # the nearest beam passes the person's middle by up to 0.9°: 1.700 m to 1.703 m
    assert beam(90.0, ranges) == pytest.approx(1.7, abs=0.003)
    assert beam(0.0, turned) == pytest.approx(1.7, abs=0.003)
    assert away[[0, -1]] == pytest.approx([1.7, 1.7])
    assert np.count_nonzero(ranges < 5.0) == 10  # 2 asin(0.3 / 2) are 17.3°, of 1.81° each


def test_a_beam_meets_a_turned_box_at_its_corner():
    box = np.array([[3.0, 0.0, math.pi / 4, 1.0, 1.0]])

    # the robot is turned so that the beam beside the heading meets the corner
    pose = Pose2D(yaw=APART / 2.0)
    assert beam(-math.degrees(APART / 2.0), scan(pose, NOBODY, box)) == pytest.approx(
        3.0 - math.sqrt(0.5)
    )


def test_nothing_behind_a_wall_shortens_a_beam():
    ahead = beam(0.0, scan(Pose2D(), np.array([[4.0, 0.0]]), WALL))
    assert ahead == pytest.approx(2.9 / math.cos(APART / 2.0))


def test_boxes_behind_the_robot_are_met_by_the_beams_behind_it():
    box = np.array([[-3.0, 0.0, 0.0, 2.0, 1.0]])

    ranges = scan(Pose2D(), NOBODY, box)

    assert ranges[0] == pytest.approx(2.0)
    assert beam(0.0, ranges) == 5.0


@pytest.mark.parametrize(
    ("person", "is_seen"), [((5.2, 0.0), True), ((5.4, 0.0), False), ((-2.0, 3.0), True)]
)
def test_people_within_5_3_m_are_seen_all_around(person, is_seen):
    assert sees(person) == is_seen


def test_a_wall_hides_a_person():
    assert not sees((4.0, 0.0), boxes=WALL)


def test_a_person_hides_another_and_a_part_beside_is_enough():
    in_front = np.array([[1.5, 0.0]])

    assert not sees((4.0, 0.0), others=in_front)
    assert sees((4.0, 0.9), others=in_front)


def test_sight_does_not_depend_on_where_the_robot_is():
    pose = Pose2D(12.0, 7.0, math.pi)
    wall = np.array([[9.0, 7.0, 0.0, 0.2, 4.0]])

    assert not sees((8.0, 7.0), boxes=wall, pose=pose)
    assert sees((10.0, 7.0), boxes=wall, pose=pose)


def test_the_map_keeps_what_a_scan_does_not_span():
    """Their map is cleared only to 1 m beyond the ends of the beams."""
    ranges = np.full(BEAMS, 1.0)
    area = KnownArea()
    area.update(ranges)  # spans 2 m about the robot

    seen = area.sees(Pose2D(), np.array([[1.6, 0.0], [4.0, 0.0]]))

    assert seen.tolist() == [False, True]


def test_an_area_is_what_a_fill_from_the_robot_reaches():
    """Compare with the flood fill, cell by cell, in a drawn crowd."""
    chance = np.random.default_rng(3)
    people = chance.uniform(-5.0, 5.0, (20, 2))
    people = people[np.hypot(*people.T) > 0.8]
    ranges = scan(Pose2D(), people, WALL)
    area = KnownArea()
    area.update(ranges)

    centres = (np.arange(120) + 0.5) / 10.0 - 6.0
    x, y = np.meshgrid(centres, centres)
    distance = np.hypot(x, y)
    low = np.floor((np.arctan2(y, x) + math.pi) / APART).astype(int)
    shortest = np.minimum(ranges[low], ranges[low + 1])
    longest = np.maximum(ranges[low], ranges[low + 1])

    # an outline is drawn in whole cells, an end two cells thick: up to three diagonals of 0.14 m
    inside = area.cells[(distance < shortest - 0.45) & (distance > 0.2)]
    outside = area.cells[(distance > longest + 0.45) & (x < 4.9)]  # spanned by the scan
    # passages narrower than two cells may be closed, and beams beside a cell reach into it
    assert inside.mean() > 0.99
    assert outside.mean() < 0.01
