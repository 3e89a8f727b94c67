"""Where commands take the robot, against ways by hand."""

import math

import numpy as np
import pytest
from mecazen.drive import Drive, Limits, MotionLimits
from mecazen.geometry import Twist2D
from mecazen_follower.planner.rollout import follow, roll

LINEAR = Limits(2.0, 2.5, 2.5)
DRIVE = Drive(2.0, 1.0, 0.3, (LINEAR, LINEAR, Limits(3.0, 8.0, 8.0)))
DT, STEPS = 0.1, 3
LIMITS = MotionLimits(DRIVE, 2.0, DT, 1)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_from_rest_it_goes_as_far_as_its_acceleration_takes_it_whatever_its_heading(yaw):
    commands = np.tile(np.array([0.0, 2.0, 0.0])[:, None], (STEPS, 1, 1))
    way = roll(yaw, Twist2D(), STEPS, LIMITS, follow(commands))
    reach = 1.25 * (DT * np.arange(1, STEPS + 1)) ** 2  # half of 2.5 m/s² times t²
    assert way.y[:, 0] == pytest.approx(reach)
    assert way.x[:, 0] == pytest.approx(np.zeros(STEPS), abs=1e-12)
    assert way.s[:, 0] == pytest.approx(math.sin(yaw))
    assert (way.commands == commands).all()


def test_who_turns_steadily_goes_along_a_circle():
    steps = 10
    way = roll(
        0.0,
        Twist2D(1.0, 0.0, 1.0),
        steps,
        LIMITS,
        lambda _, x, y, yaw: np.array((np.cos(yaw), np.sin(yaw), np.ones_like(yaw))),
    )
    # the mean of both directions is shorter than the chord by a twelfth of the step's turn squared
    short = DT**2 / 12
    circle = math.sin(1.0), 1.0 - math.cos(1.0)
    assert (way.x[-1, 0], way.y[-1, 0]) == pytest.approx(circle, rel=2.0 * short)
