"""The curves of the plots."""

import math

import pytest
from mecazen import messages as m
from mecazen.geometry import Pose2D
from mecazen.robot import WHEEL_JOINTS
from mecazen_viewer import entities as e
from mecazen_viewer.plots import LINES, TIME_LINES
from viewer.pictures import following, odometry, physics_says, picture, place, scalars

MS = 10**6


def test_errors_are_true_and_as_the_follower_has_them():
    shown = picture()
    list(shown.on_ground_truth(odometry(Pose2D(-1.2, 0.0, 0.1)), 0))
    list(shown.on_target_odom(odometry(Pose2D()), 0))
    list(shown.on_odom(odometry(Pose2D(-1.2, 0.0, 0.1)), 0))
    entities = dict(shown.on_follower_state(following(Pose2D(0.1), Pose2D(-0.9)), 0))
    # the goal is 1 m behind the estimate, the robot 1.2 m behind the true person
    assert scalars(entities, e.DISTANCE)[-2:] == pytest.approx((0.25, 0.2))
    assert scalars(entities, e.ANGLE)[-2:] == pytest.approx((math.degrees(0.5), math.degrees(0.1)))
    # the estimate is 0.1 m off by a standard deviation of 0.1 m
    assert scalars(entities, e.NEES)[-1] == pytest.approx(1.0)
    assert place(entities, e.GOAL) == pytest.approx((-0.9, 0.0, 0.0), abs=1e-6)


def test_of_a_follower_that_tells_nothing_the_true_errors_are_shown():
    shown = picture()
    list(shown.on_ground_truth(odometry(Pose2D(-1.2, 0.0, 0.1)), 0))
    entities = dict(shown.on_target_odom(odometry(Pose2D()), 0))
    # the robot is to be 1 m behind the person, and is 1.2 m behind
    *_, estimated, true = scalars(entities, e.DISTANCE)
    assert math.isnan(estimated)
    assert true == pytest.approx(0.2)
    assert scalars(entities, e.ANGLE)[-1] == pytest.approx(math.degrees(0.1))
    list(shown.on_follower_state(following(Pose2D(0.1), Pose2D(-0.9)), 100 * MS))
    assert e.DISTANCE not in dict(shown.on_target_odom(odometry(Pose2D()), 200 * MS))


def test_a_command_of_efforts_plots_no_speeds():
    efforts = m.JointState(name=WHEEL_JOINTS, effort=(1.0,) * 4)
    assert list(picture().on_joint_command(efforts, 0)) == []


def test_every_line_that_is_drawn_has_a_name_and_a_colour():
    shown = picture()
    list(shown.on_ground_truth(odometry(Pose2D()), 0))
    list(shown.on_target_odom(odometry(Pose2D(1.0)), 0))
    drawn = [
        *shown.on_odom(odometry(Pose2D()), 0),
        *shown.on_cmd_vel(m.Twist(), 0),
        *shown.on_joint_states(m.JointState(velocity=(1.0, 2.0, 3.0, 4.0, 5.0)), 0),
        *shown.on_joint_command(m.JointState(name=WHEEL_JOINTS, velocity=(1.0,) * 4), 0),
        *shown.on_follower_state(following(Pose2D(1.0), Pose2D()), 0),
        *shown.on_diagnostics(physics_says("0.5"), 0, "physics"),
    ]
    plotted = {path: archetype for path, archetype in drawn if path.startswith("plots/")}
    lines = LINES | TIME_LINES
    assert set(plotted) == set(lines)
    for path in plotted:
        assert len(scalars(plotted, path)) == len(lines[path])
