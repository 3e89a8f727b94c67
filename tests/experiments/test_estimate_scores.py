"""Scores of estimates, tracking and odometry, against figures worked out by hand."""

import math

import numpy as np
import pytest
from experiments.made_up import TICK_S, beside, covariances, line, run, twist, whole
from mecazen.geometry import Pose2D
from mecazen_experiments.scores import nees
from mecazen_experiments.table import Poses, wrap
from scipy import stats

# --- estimation ----------------------------------------------------------------------------


def placed(person, robot, odom):
    """The person in odom, as seen from the true robot."""
    return odom.compose(robot.between(person))


def estimated(ticks, error, covariance, yaw=0.3, **given):
    """A run whose odometry lies elsewhere than world, with errors [m, m, rad] along odom."""
    person = line(ticks, yaw=yaw)
    robot = beside(person, 1.3, 170.0, 10.0)
    odom = Poses(robot.y + 5.0, -robot.x, robot.yaw - math.pi / 2)
    truth = placed(person, robot, odom)
    x, y, turn = (true + off for true, off in zip(truth, error, strict=True))
    estimate = Poses(x, y, wrap(turn))
    poses = {"target": person, "robot": robot, "odom": odom, "estimate": estimate}
    return run(ticks, **poses, **covariances(covariance), **given)


def test_an_estimate_is_compared_with_the_person_as_seen_from_the_robot():
    velocity = twist("estimate", 0.3, 0.4) | twist("target", 0.2)
    table = estimated(50, (0.03, -0.04, math.radians(-5.0)), np.eye(3), **velocity)
    found = whole(table)
    assert found.estimate_position_err_m == pytest.approx(0.05)
    assert found.estimate_yaw_err_deg == pytest.approx(5.0)
    assert found.estimate_speed_err_m_s == pytest.approx(0.3)  # 0.5 for 0.2


def test_a_drift_of_the_odometry_is_no_error_of_the_estimate():
    ticks = 100
    person = line(ticks)
    robot = beside(person, 1.0, 180.0, 0.0)
    odom = Poses(1.5 * robot.x, robot.y + 0.1 * robot.x, robot.yaw + 0.2 * robot.x)
    poses = {"target": person, "robot": robot, "odom": odom}
    estimate = placed(person, robot, odom)
    found = whole(run(ticks, **poses, estimate=estimate, **covariances(np.eye(3))))
    assert found.estimate_position_err_m == pytest.approx(0.0, abs=1e-12)
    assert found.estimate_yaw_err_deg == pytest.approx(0.0, abs=1e-12)


def test_nees_weighs_each_error_by_its_covariance():
    # 0.1² / 0.02 + 0.2² / 0.01 + 0.3² / 0.09
    diagonal = estimated(50, (0.1, 0.2, 0.3), np.diag([0.02, 0.01, 0.09]))
    assert whole(diagonal).nees == pytest.approx(0.5 + 4.0 + 1.0)
    # (0.1, 0.1) is an eigenvector of [[2, 1], [1, 2]] with the eigenvalue 3, (0.1, -0.1) with 1
    correlated = np.array([[0.02, 0.01, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 1.0]])
    assert whole(estimated(50, (0.1, 0.1, 0.0), correlated)).nees == pytest.approx(0.02 / 0.03)
    assert whole(estimated(50, (0.1, -0.1, 0.0), correlated)).nees == pytest.approx(0.02 / 0.01)


# the heading of the person is on the cut in odom: half of the errors reach across it
@pytest.mark.parametrize("yaw", [0.3, -math.pi / 2])
def test_nees_of_errors_drawn_from_their_covariance_is_3(yaw):
    ticks = 2001
    root = np.array([[0.05, 0.0, 0.0], [0.02, 0.04, 0.0], [-0.03, 0.01, 0.08]])
    errors = root @ np.random.default_rng(1).standard_normal((3, ticks))
    found = whole(estimated(ticks, errors, root @ root.T, yaw=yaw))
    # the sum of n values of chi-square with 3 degrees of freedom is one with 3 n
    n = ticks - 1
    low, high = stats.chi2.ppf([0.001, 0.999], 3 * n) / n
    assert low < found.nees < high
    # a percentile of n values has the deviation sqrt(p (1 - p) / n) / density
    p95 = stats.chi2.ppf(0.95, 3)
    deviation = math.sqrt(0.95 * 0.05 / n) / stats.chi2.pdf(p95, 3)
    assert found.nees_p95 == pytest.approx(p95, abs=3 * deviation)


def test_ticks_without_an_estimate_are_left_out():
    ticks = 101
    known = np.arange(ticks) >= 51
    error = np.where(known, 0.1, np.nan), np.where(known, 0.0, np.nan), np.where(known, 0.0, np.nan)
    covariance = np.where(known[:, None, None], 0.01 * np.eye(3), np.nan)
    found = whole(estimated(ticks, error, covariance))
    assert found.estimate_position_err_m == pytest.approx(0.1)
    assert found.nees == pytest.approx(1.0)


def test_without_a_covariance_there_is_an_error_but_no_nees():
    found = whole(estimated(50, (0.1, 0.0, 0.0), np.zeros((3, 3))))
    assert found.estimate_position_err_m == pytest.approx(0.1)
    assert found.nees is None
    assert found.nees_p95 is None


def test_nees_is_said_only_where_the_covariance_is_positive_definite():
    good, none, saddle = np.eye(2), np.zeros((2, 2)), np.diag([-1.0, -1.0])
    found = nees(np.ones((3, 2)), np.array([good, none, saddle]))
    assert found[0] == pytest.approx(2.0)
    assert np.isnan(found[1:]).all()


# --- tracking and odometry -----------------------------------------------------------------


@pytest.mark.parametrize(("every", "lost", "coasting"), [(1, 10, 30), (4, 12, 28)])
def test_time_is_counted_by_the_newest_state_of_tracking(every, lost, coasting):
    tick = np.arange(101)
    tracking = np.select([tick > 90, tick > 60], ["lost", "coasting"], default="following")
    person = line(101)
    reported = np.where(tick % every == 0, tracking, "")
    found = whole(run(101, target=person, robot=person, tracking=reported))
    assert found.lost_s == pytest.approx(lost * TICK_S)
    assert found.coasting_s == pytest.approx(coasting * TICK_S)


def test_drift_is_the_share_of_the_path_by_which_the_odometry_is_off_at_the_end():
    ticks = 1001
    way = 0.01 * np.arange(ticks)  # after the first motion 9.99 m
    odom = (3.0, 0.98 * way, math.pi / 2)  # 2 % short, in a frame of its own
    found = whole(run(ticks, target=line(ticks), robot=(way, 0.0, 0.0), odom=odom))
    assert found.odometry_drift_percent == pytest.approx(2.0)


def test_an_odometry_that_is_off_in_yaw_at_the_start_alone_has_no_drift():
    ticks = 100
    robot = Poses(*(0.01 * np.arange(ticks) * k for k in (1.0, 0.5, 0.3)))
    odom = Poses(*(np.full(ticks, number) for number in Pose2D(1.0, 2.0, 2.0))).compose(robot)
    found = whole(run(ticks, target=line(ticks), robot=robot, odom=odom))
    assert found.odometry_drift_percent == pytest.approx(0.0, abs=1e-9)


def test_of_a_path_below_10_cm_there_is_no_drift():
    way = 0.001 * np.arange(100)
    found = whole(run(100, target=line(100), robot=(way, 0.0, 0.0), odom=(0.5 * way, 0.0, 0.0)))
    assert found.odometry_drift_percent is None
