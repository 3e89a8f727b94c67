"""The motion of a person: driven by twists, and the ripple of gait; its twist: test_paths."""

import math

import pytest
from mecazen.config.people import Gait, Standing, Straight
from mecazen.geometry import Pose2D, Twist2D
from mecazen_people.motion import Driven, Motion, with_gait
from mecazen_people.paths import make_path

GAIT = Gait(sway_m=0.03, speed_ripple=0.1, step_length_m=0.5)


def test_gait_sways_once_a_stride_and_pulses_once_a_step():
    path = make_path(Straight(speed_m_s=1.0))
    steps = [with_gait(path.at(t), GAIT) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
    # Left over one foot, right over the other; fastest as the feet change.
    assert [m.pose.y for m in steps] == pytest.approx([0.0, 0.03, 0.0, -0.03, 0.0], abs=1e-12)
    assert [m.twist.x for m in steps] == pytest.approx([1.1, 0.9, 1.1, 0.9, 1.1])
    assert [m.pose.x for m in steps] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_gait_keeps_heading_yaw_rate_and_distance():
    motion = Motion(Pose2D(1.0, 2.0, 0.7), Twist2D(0.9, 0.1, 0.4), 12.3)
    rippled = with_gait(motion, GAIT)
    assert rippled.pose.yaw == pytest.approx(0.7)
    assert rippled.twist.yaw == 0.4
    assert rippled.distance == 12.3
    # Never further off than both amplitudes: 0.1·0.5/(2·pi) = 8 mm and 30 mm.
    assert math.dist(rippled.pose[:2], motion.pose[:2]) <= math.hypot(0.008, 0.03)


def test_gait_of_a_standing_person_is_nothing():
    motion = make_path(Standing(x_m=3.0)).at(7.0)
    assert with_gait(motion, GAIT) == motion


def test_person_who_stops_in_mid_step_stands_where_they_are():
    path = make_path(Straight(length_m=1.3, speed_m_s=1.0))
    before, after = (with_gait(path.at(t), GAIT) for t in (1.3 - 1e-9, 1.3))
    assert after.pose == pytest.approx(before.pose, abs=1e-8)  # 1e-9 s at 1 m/s
    assert after.twist == Twist2D()
    assert with_gait(path.at(60.0), GAIT) == after


START = Pose2D(1.0, 2.0, math.pi / 2)


def test_driven_person_walks_an_exact_arc():
    person = Driven(START, timeout=10.0, tick_s=0.01)
    person.command(Twist2D(0.2, 0.0, 0.1))
    for _ in range(500):
        person.step()
    # 5 s: 1 m on a circle of radius 2 m, 0.5 rad to the left; rounding of 500 sums.
    expected = (1.0 - 2.0 * (1.0 - math.cos(0.5)), 2.0 + 2.0 * math.sin(0.5), math.pi / 2 + 0.5)
    assert person.motion.pose == pytest.approx(expected, abs=1e-12)
    assert person.motion.distance == pytest.approx(1.0)
    assert person.motion.twist == Twist2D(0.2, 0.0, 0.1)
