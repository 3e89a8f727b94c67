"""A person driven by twists."""

import math

import pytest
from mecazen.geometry import Pose2D, Twist2D
from mecazen_target.motion import Driven, Motion

START = Pose2D(1.0, 2.0, math.pi / 2)


def test_driven_person_stands_until_commanded() -> None:
    person = Driven(START, timeout=0.5, tick_s=0.01)
    assert person.motion == Motion(START)
    assert person.step() == Motion(START)


def test_driven_person_walks_an_exact_arc() -> None:
    person = Driven(START, timeout=10.0, tick_s=0.01)
    person.command(Twist2D(0.2, 0.0, 0.1))
    for _ in range(500):
        person.step()
    # 5 s: 1 m on a circle of radius 2 m, 0.5 rad to the left; rounding of 500 sums.
    expected = (1.0 - 2.0 * (1.0 - math.cos(0.5)), 2.0 + 2.0 * math.sin(0.5), math.pi / 2 + 0.5)
    assert person.motion.pose == pytest.approx(expected, abs=1e-12)
    assert person.motion.distance == pytest.approx(1.0)
    assert person.motion.twist == Twist2D(0.2, 0.0, 0.1)


def test_driven_person_stops_after_the_timeout_and_walks_on_at_the_next_command() -> None:
    person = Driven(Pose2D(), timeout=0.3, tick_s=0.1)
    person.command(Twist2D(1.0, 0.0, 0.0))
    assert [person.step().twist.x for _ in range(5)] == [1.0, 1.0, 1.0, 0.0, 0.0]
    assert person.motion.pose.x == pytest.approx(0.3)
    person.command(Twist2D(0.0, -1.0, 0.0))
    assert person.step().pose == pytest.approx((0.3, -0.1, 0.0))


def test_new_command_starts_the_timeout_again() -> None:
    person = Driven(Pose2D(), timeout=0.3, tick_s=0.1)
    for _ in range(10):
        person.command(Twist2D(1.0, 0.0, 0.0))
        person.step()
    assert person.motion.pose.x == pytest.approx(1.0)
