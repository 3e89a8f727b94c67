"""The entities for each message, and their times."""

import math

import numpy as np
import pytest
from mecazen import messages as m
from mecazen.geometry import Pose2D
from mecazen.skeleton import LIMBS
from mecazen_viewer import entities as e
from viewer.pictures import following, odometry, picture, place, scalars
from viewer_stage import COVARIANCE, values

MS = 10**6
POINTS = e.OBSERVATION, "Points3D:positions"
SEEN = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), COVARIANCE)


def test_the_robot_stands_where_it_truly_is_and_the_view_follows_the_middle_to_the_person():
    shown = picture()
    list(shown.on_target_odom(odometry(Pose2D(3.0, 2.0)), 0))
    entities = dict(shown.on_ground_truth(odometry(Pose2D(1.0, 2.0, 0.5)), 0))
    assert place(entities, e.ROBOT) == pytest.approx((1.0, 2.0, 0.5), abs=1e-6)
    assert place(entities, e.FOLLOW) == pytest.approx((2.0, 2.0, 0.0), abs=1e-6)


def test_the_frame_of_drifted_odometry_is_laid_so_that_the_robot_in_it_is_the_true_one():
    shown = picture()
    truth, drifted = Pose2D(1.0, 2.0, 0.5), Pose2D(0.7, 2.2, 0.4)
    list(shown.on_ground_truth(odometry(truth), 0))
    frame = place(shown.on_odom(odometry(drifted), 0), e.ODOM)
    assert frame.compose(drifted) == pytest.approx(truth, abs=1e-6)


def test_an_observation_is_seen_from_where_the_robot_was_at_its_capture():
    shown = picture()
    for tick in range(5):
        list(shown.on_ground_truth(odometry(Pose2D(y=0.1 * tick, yaw=math.pi / 2)), tick * 10 * MS))
    frame = m.Observation(m.Header(m.Time.from_ns(20 * MS), "base_link"), (SEEN,))
    entities = dict(shown.on_observation(frame, 40 * MS))
    # 1 m ahead of a robot at y = 0.2 m that looks along y
    assert values(entities, *POINTS)[0][:2] == pytest.approx((0.0, 1.2))
    stretch = values(entities, e.OBSERVATION_ELLIPSE, "Transform3D:mat3x3")[0]
    # 0.1 m times the square root of chi-square's 95 % quantile with two freedoms
    assert np.abs(stretch).max() == pytest.approx(1.0)
    assert np.abs(np.linalg.svd(stretch.reshape(3, 3))[1][1:]) == pytest.approx(
        [0.2448, 0.2448], abs=1e-3
    )


def test_what_the_sensor_saw_goes_one_by_one_when_it_sees_nothing():
    shown = picture()
    frame, nothing = m.Observation(m.Header(frame_id="world"), (SEEN,)), m.Observation()
    counts = [
        len(values(dict(shown.on_observation(message, 100 * MS * i)), *POINTS))
        for i, message in enumerate((frame, frame, nothing, nothing, nothing))
    ]
    assert counts == [1, 2, 1, 0, 0]


def test_the_nees_of_a_good_estimate_does_not_know_of_the_drift_of_odometry():
    shown = picture()
    robot, person, drifted = Pose2D(2.0, 1.0, 0.3), Pose2D(3.0, 1.0, 0.2), Pose2D(9.0, 9.0, 2.0)
    list(shown.on_ground_truth(odometry(robot), 0))
    list(shown.on_target_odom(odometry(person), 0))
    list(shown.on_odom(odometry(drifted), 0))
    estimate = drifted.compose(robot.between(person))
    entities = dict(shown.on_follower_state(following(estimate, drifted), 0))
    # rounding alone
    assert scalars(entities, e.NEES)[-1] == pytest.approx(0.0, abs=1e-12)


def test_lines_have_ten_points_a_second():
    shown = picture()
    twists = [
        entity for tick in range(101) for entity in shown.on_cmd_vel(m.Twist(), tick * 10 * MS)
    ]
    assert len(twists) == 2 * 11  # velocity and yaw rate


def test_the_grid_is_laid_anew_only_when_the_robot_has_gone_far():
    shown = picture()
    assert list(shown.statics()) == []
    laid = []
    for x in (0.0, 1.0, 4.0, 12.0, 13.0):
        list(shown.on_ground_truth(odometry(Pose2D(x)), 0))
        laid.append(len(list(shown.statics())))
    assert laid == [1, 0, 0, 1, 0]


def test_estimate_goal_and_ellipses_have_no_shape_before_they_have_a_place():
    shown = picture()
    list(shown.on_target_odom(odometry(Pose2D(3.0)), 0))
    assert [path for path, _ in shown.statics()] == [f"{e.PERSON}/arrow"]
    frame = m.Observation(m.Header(frame_id="world"), (SEEN,))
    list(shown.on_observation(frame, 0))
    assert [path for path, _ in shown.statics()] == [f"{e.OBSERVATION_ELLIPSE}/outline"]
    list(shown.on_follower_state(following(Pose2D(), Pose2D()), 0))
    placed = {path.rpartition("/")[0] for path, _ in shown.statics()}
    assert placed == {e.ESTIMATE, e.ESTIMATE_ELLIPSE, e.GOAL}
    list(shown.on_follower_state(following(Pose2D(), Pose2D()), 100 * MS))
    assert list(shown.statics()) == []


def test_a_person_whose_joints_no_service_publishes_has_a_body_all_the_same():
    entities = dict(picture().on_target_odom(odometry(Pose2D(3.0, 2.0)), 0))
    limbs = np.array(values(entities, e.BODY, "LineStrips3D:strips"))
    assert len(limbs) == len(LIMBS) + 2  # neck and shoulders
    low, high = limbs.reshape(-1, 3).min(axis=0), limbs.reshape(-1, 3).max(axis=0)
    assert (low + high)[:2] / 2 == pytest.approx((3.0, 2.0), abs=0.1)
    assert high[2] - low[2] == pytest.approx(1.65, abs=0.1)  # from sole to the middle of the head
