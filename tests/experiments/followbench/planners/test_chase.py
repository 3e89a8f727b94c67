"""The goals of the reference planners."""

from __future__ import annotations

import math

import numpy as np
import pytest
from experiments.followbench.planners.views import view
from filterpy.kalman import KalmanFilter
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.planners.chase import Chase, ConstantVelocity, place
from mecazen_experiments.followbench.view import Seen

WALKER = Seen(10.0, 5.0, 1.0, 0.0)


def test_behind_the_target_is_on_the_line_to_the_robot() -> None:
    goal = place(WALKER, 0.0, Pose2D(10.0, 1.0), "back", 1.5)
    assert goal == pytest.approx((10.0, 3.5, math.pi / 2))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_beside_the_target_is_the_nearer_side(side: float) -> None:
    goal = place(WALKER, 0.0, Pose2D(8.0, 5.0 + side), "left_side", 1.5)
    assert goal == pytest.approx((10.0, 5.0 + 1.5 * side, 0.0))


def test_the_prediction_is_that_of_a_kalman_filter() -> None:
    model = KalmanFilter(dim_x=4, dim_z=4)
    model.x = np.array(WALKER)
    model.F = np.eye(4) + 0.1 * np.eye(4, k=2)
    model.H = np.eye(4)
    model.P, model.Q, model.R = 0.01 * np.eye(4), 0.0025 * np.eye(4), 0.25 * np.eye(4)
    ours = ConstantVelocity(WALKER)
    for k in range(30):
        measured = Seen(10.0 + 0.05 * k, 5.0 - 0.01 * k * k, 0.4, -0.2 * k)
        model.predict()
        model.update(np.array(measured))
        ours.step(measured)
    x, y, vx, vy = model.x
    # rounding of some 30 products of matrices
    assert ours.ahead(2.0) == pytest.approx((x + 2 * vx, y + 2 * vy, vx, vy), rel=1e-9)


def test_a_lost_target_is_sought_two_seconds_ahead() -> None:
    chase, robot = Chase(), Pose2D(8.0, 5.0)
    chase.goal(view(robot, WALKER))
    goal = chase.goal(view(robot, None))
    # 0.2 m before 10 + 2; the first step of the filter moves it by 0.1 m less its correction
    assert goal.x == pytest.approx(11.8, abs=0.1)
    assert goal.y == pytest.approx(5.0)


def test_a_target_that_stands_keeps_its_heading() -> None:
    chase, robot = Chase(), Pose2D(8.0, 7.0)
    chase.goal(view(robot, Seen(10.0, 5.0, 0.0, 1.0), place="left_side"))
    goal = chase.goal(view(robot, Seen(10.0, 5.0, 0.0, 0.0), place="left_side"))
    assert goal == pytest.approx((8.5, 5.0, math.pi / 2))


def test_a_robot_that_never_saw_the_target_stays() -> None:
    assert Chase().goal(view(Pose2D(1.0, 2.0, 3.0), None)) == (1.0, 2.0, 3.0)
