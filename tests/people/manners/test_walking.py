"""The common parts of all manners: outlines, errands, and turns of the body."""

import math

import pytest
from mecazen.config.people import Goal
from mecazen.geometry import Pose2D
from mecazen_people.manners.walking import Errand, Other, Outline, walked
from mecazen_people.motion import Motion


def test_the_gap_to_a_turned_outline_is_measured_in_its_frame():
    # half a metre ahead of a robot that looks along y, and beside it
    outline = Outline(ahead=0.6, behind=0.1, side=0.275, yaw=math.pi / 2)
    assert outline.gap(0.0, 1.1) == pytest.approx(0.5)
    assert outline.gap(0.0, -0.6) == pytest.approx(0.5)
    assert outline.gap(0.775, 0.3) == pytest.approx(0.5)
    assert outline.gap(0.0, 0.3) == 0.0


def test_the_gap_to_a_disc_is_measured_to_its_edge():
    assert Other(1.0, 0.0, 0.0, 0.0, 0.3).gap(0.0, 0.0) == pytest.approx(0.7)


def test_an_errand_back_and_forth_passes_the_same_places_in_both_directions():
    path = Goal(goal_m=(4.0, 0.0), via_m=((2.0, 1.0),), back_and_forth=True, x_m=1.0)
    errand = Errand.of(path)
    assert errand.goals == ((2.0, 1.0), (4.0, 0.0), (2.0, 1.0), (1.0, 0.0))
    assert errand.endless


def test_a_body_turns_to_where_it_goes_and_adds_up_its_way():
    motion = Motion(Pose2D())
    for step in range(1, 21):
        motion = walked(motion, (0.0, 0.1 * step), (0.0, 1.0), 0.1)
    assert motion.pose.yaw == pytest.approx(math.pi / 2, abs=0.01)  # a lag of 0.2 s
    assert motion.distance == pytest.approx(2.0)


def test_who_stands_does_not_turn():
    motion = walked(Motion(Pose2D(yaw=0.3)), (0.0, 0.0), (0.0, 0.01), 0.1)
    assert (motion.pose.yaw, motion.twist.yaw) == (0.3, 0.0)
