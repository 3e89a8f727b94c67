"""A person driven by twists."""

import math

import pytest
from mecazen.geometry import Pose2D, Twist2D
from mecazen_people.motion import Driven

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


def test_new_command_starts_the_timeout_again():
    person = Driven(Pose2D(), timeout=0.3, tick_s=0.1)
    for _ in range(10):
        person.command(Twist2D(1.0, 0.0, 0.0))
        person.step()
    assert person.motion.pose.x == pytest.approx(1.0)
