"""Plots, log and health: messages in, and what the recording has beside the scene."""

import math
from typing import Any

import pytest
from harness import load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.config import RobotConfig, Scenario, StartConfig
from mecazen.geometry import Pose2D, wrap
from mecazen.robot import WHEEL_JOINTS
from mecazen_viewer import layout
from mecazen_viewer.panels import ROBOT_PLOTS, SHARED_PLOTS
from viewer.drawing import Drawing, following, odometry, report

PHYSICS, TARGET = keys.diagnostics("physics"), keys.diagnostics("target")


@pytest.fixture
def drawing(tmp_path):
    return Drawing(tmp_path)


def test_errors_are_plotted_true_and_as_estimated(drawing):
    robot = odometry(Pose2D(-1.2, 0.0, 0.1))
    drawing.put(keys.GROUND_TRUTH, robot)
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D()))
    drawing.put(keys.ODOM, robot)
    drawing.put(keys.FOLLOWER_STATE, following(Pose2D(0.1), Pose2D(-0.9)))
    content = drawing.end()
    # the goal is 1 m behind the estimate, the robot 1.2 m behind the true person
    assert content.plotted(layout.DISTANCE)[-2:] == pytest.approx((0.25, 0.2))
    angles = math.degrees(0.5), math.degrees(0.1)
    assert content.plotted(layout.ANGLE)[-2:] == pytest.approx(angles)
    # the estimate is 0.1 m off by a standard deviation of 0.1 m
    assert content.plotted(layout.NEES)[-1] == pytest.approx(1.0)


def test_nees_is_independent_of_the_drift_of_odometry(drawing):
    truth, drifted, person = Pose2D(1.0, 2.0, 3.0), Pose2D(0.6, 2.1, -3.1), Pose2D(2.0, 2.5, 0.5)
    in_odom = drifted.compose(truth.between(person))
    drawing.put(keys.GROUND_TRUTH, odometry(truth))
    drawing.put(keys.TARGET_ODOM, odometry(person))
    drawing.put(keys.ODOM, odometry(drifted))
    # 2 standard deviations along x, and half of one about z, across the cut of the angle
    estimate = Pose2D(in_odom.x + 0.2, in_odom.y, wrap(in_odom.yaw + 0.1))
    drawing.put(keys.FOLLOWER_STATE, following(estimate, Pose2D()))
    assert drawing.end().plotted(layout.NEES)[-1] == pytest.approx(4.25)


def test_true_errors_are_plotted_unless_the_follower_reports(drawing):
    drawing.put(keys.GROUND_TRUTH, odometry(Pose2D(-1.2, 0.0, 0.1)))
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D()))
    drawing.put(keys.FOLLOWER_STATE, following(Pose2D(0.1), Pose2D(-0.9)), 100)
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D()), 200)
    errors = drawing.end().all(layout.DISTANCE, "Scalars:scalars")
    assert len(errors) == 2
    assert math.isnan(errors[0][2])
    assert errors[0][3] == pytest.approx(0.2)  # 1.2 m behind the person instead of 1 m


def test_command_of_efforts_plots_no_speeds(drawing):
    drawing.put(keys.JOINT_COMMAND, m.JointState(name=WHEEL_JOINTS, effort=(1.0,) * 4))
    assert drawing.end().all(f"{layout.WHEEL_SPEED}/commanded", "Scalars:scalars") == []


def test_every_plot_has_a_style_for_each_value_ten_times_a_second(drawing):
    five = (1.0, 2.0, 3.0, 4.0, 5.0)
    for step in range(21):
        ms = 50 * step
        drawing.put(keys.GROUND_TRUTH, odometry(Pose2D()), ms)
        drawing.put(keys.TARGET_ODOM, odometry(Pose2D(1.0)), ms)
        drawing.put(keys.ODOM, odometry(Pose2D()), ms)
        drawing.put(keys.CMD_VEL, m.Twist(), ms)
        drawing.put(keys.JOINT_STATES, m.JointState(velocity=five), ms)
        drawing.put(keys.JOINT_COMMAND, m.JointState(name=WHEEL_JOINTS, velocity=five[:4]), ms)
        drawing.put(keys.FOLLOWER_STATE, following(Pose2D(1.0), Pose2D()), ms)
        drawing.put(PHYSICS, report("physics", rtf="0.5"), ms)
    content = drawing.end()
    for path, lines in (ROBOT_PLOTS | SHARED_PLOTS).items():
        assert len(content.plotted(path)) == len(lines)
        assert len(content.last(path, "SeriesLines:names")) == len(lines)
    assert len(content.all(f"{layout.VELOCITY}/commanded", "Scalars:scalars")) == 11


def test_changes_of_tracking_guard_and_health_are_logged(drawing):
    ended = report("target", walk_ended="True")
    for step, (topic, message) in enumerate(
        (
            (keys.FOLLOWER_STATE, m.FollowerState(tracking="waiting")),
            (keys.FOLLOWER_STATE, m.FollowerState(tracking="waiting")),
            (keys.FOLLOWER_STATE, m.FollowerState(tracking="coasting", reason=m.Unseen.WALL)),
            (keys.GUARD_STATE, m.GuardState(state="stop", reason="0.30 m ahead")),
            (keys.GUARD_STATE, m.GuardState(state="stop", reason="0.29 m ahead")),
            (keys.GUARD_STATE, m.GuardState(state="clear")),
            (PHYSICS, report("physics", rtf="1.0")),
            (PHYSICS, report("physics", rtf="1.1")),
            (PHYSICS, report("physics", 1, "refused payloads")),
            (TARGET, report("target")),
            (TARGET, ended),
            (TARGET, ended),
        )
    ):
        drawing.put(topic, message, 100 * step)
    content = drawing.end()
    coasting = "WARN tracking: coasting hidden by a wall"
    assert content.log("follower") == ["INFO tracking: waiting", coasting]
    assert content.log("guard") == ["WARN guard: stop 0.30 m ahead", "INFO guard: clear"]
    assert content.log("physics") == ["INFO physics: ok", "WARN physics: refused payloads"]
    assert content.log("target") == ["INFO target: ok", "INFO target: the walk has ended"]


def test_health_has_the_newest_values_of_all_services_of_all_robots(tmp_path):
    robots = tuple(
        RobotConfig(name=name, start=StartConfig(y_m=y)) for name, y in (("one", 0.0), ("two", 1.0))
    )
    drawing = Drawing(tmp_path, Scenario(robot=load_robot(), robots=robots))
    drawing.put(PHYSICS, report("physics", rtf="0.123456"))
    drawing.put(PHYSICS, report("physics", rtf="0.987654"), 100)
    for robot in ("two", "one"):
        drawing.put(keys.diagnostics("follower"), report("follower"), 100, robot)
        drawing.put(keys.FOLLOWER_STATE, m.FollowerState(tracking="lost"), 100, robot)
        drawing.put(keys.GROUND_TRUTH, odometry(Pose2D()), 100, robot)
    content = drawing.end()
    ((text,),) = content.all(layout.HEALTH, "TextDocument:text")[-1:]
    assert text.splitlines()[2:] == [
        "| one/follower | ok |  |",
        "| physics | ok | rtf 0.9877 |",
        "| two/follower | ok |  |",
    ]
    lines = [f"ERROR {robot}/tracking: lost" for robot in ("one", "two")]
    logged = [*content.log("one/follower"), *content.log("two/follower")]
    assert [line for line in logged if "tracking" in line] == lines
    assert {"world/one/robot", "world/two/robot", "plots/two/distance"} <= content.paths


def test_markup_and_control_characters_of_clients_are_escaped(drawing):
    values = {"[x](http://y)": "a | <b> \x1b[2J\n| physics | ok |"}
    drawing.put(PHYSICS, report("physics", 1, "\x1b]0;", **values))
    content = drawing.end()
    assert content.log("physics") == ["WARN physics: \\u001b]0;"]
    ((text,),) = content.all(layout.HEALTH, "TextDocument:text")
    escaped = r"\[x\]\(http://y\) a \| \<b\> \\u001b\[2J\\n\| physics \| ok \|"
    assert text.splitlines()[2:] == [rf"| physics | warning | \\u001b\]0;, {escaped} |"]


def origins(part: Any) -> set[str]:
    """Where the views of a part of the layout begin."""
    if hasattr(part, "origin"):
        return {part.origin}
    return set().union(*(origins(child) for child in part.contents))


def test_layout_shows_all_plots_and_texts_of_each_robot():
    single = origins(layout.blueprint(("",)).root_container)
    assert {layout.FOLLOW, layout.HEALTH, layout.LOG} <= single
    for path in ROBOT_PLOTS | SHARED_PLOTS:
        assert any(path == origin or path.startswith(f"{origin}/") for origin in single)
    tabs = layout.blueprint(("one", "two")).root_container.contents
    assert [tab.name for tab in tabs] == ["one", "two"]
    for tab in tabs:
        shared = {layout.REAL_TIME, layout.HEALTH, layout.LOG}
        assert origins(tab) == shared | {
            layout.path_of_robot(path, tab.name) for path in single - shared
        }
    # a user's changes of the layout are stored by the name of the application
    assert len({layout.application(robots) for robots in (("",), ("one",), ("one", "two"))}) == 3
