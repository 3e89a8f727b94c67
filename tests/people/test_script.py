"""Scripted walks: velocities one after the other, with a limited acceleration."""

import math

import pytest
from mecazen.geometry import Twist2D
from mecazen_people.script import Script
from people.differences import differences

CELL_S = 0.005


def test_a_hard_stop_covers_v_squared_over_2a():
    walk = Script([(3.0, Twist2D(1.8, 0.0, 0.0))], 6.0, 12.0)
    speeding_up, at_speed = walk.at(0.3).pose.x, walk.at(3.0).pose.x
    # a ramp ends within a cell of when it should
    assert speeding_up == pytest.approx(1.8**2 / 12.0, abs=1.8 * CELL_S)
    assert walk.duration == pytest.approx(3.3, abs=CELL_S)
    assert walk.at(10.0).pose.x - at_speed == pytest.approx(1.8**2 / 12.0, abs=1e-9)
    assert walk.at(10.0).twist == Twist2D()


def test_a_person_steps_back_aside_and_turns_on_the_spot():
    walk = Script(
        [
            (2.0, Twist2D(-0.5, 0.0, 0.0)),
            (2.0, Twist2D(0.0, 0.4, 0.0)),
            (2.0, Twist2D(0.0, 0.0, math.pi / 2)),
        ],
        1e9,
        1e9,
    )
    x, y, yaw = walk.at(6.1).pose
    # of each change of the velocity half a cell has the mean of both
    assert (x, y) == pytest.approx((-1.0, 0.8), abs=0.5 * CELL_S)
    assert abs(yaw) == pytest.approx(math.pi, abs=math.pi / 2 * CELL_S)
    assert walk.at(6.1).distance == pytest.approx(1.8, abs=CELL_S)


def test_its_twist_is_the_derivative_of_its_pose():
    walk = Script([(1.0, Twist2D(1.0, 0.2, 0.5)), (1.0, Twist2D(-0.5, 0.0, 1.0))], 2.0, 4.0)
    for t in (0.1013, 0.6031, 1.2027, 1.9046, 2.3012):
        now, twist, speed = differences(walk, None, t, 1e-5)
        assert twist == pytest.approx(now.twist, abs=1e-4)
        assert speed == pytest.approx(math.hypot(now.twist.x, now.twist.y), abs=1e-4)
