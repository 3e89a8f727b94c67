"""Plots, log and health: messages in, and what the recording has beside the scene."""

import math

import pytest
from harness import load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.config import RobotConfig, Scenario, StartConfig
from mecazen.geometry import Pose2D, wrap
from mecazen_viewer import layout
from viewer.drawing import Drawing, following, odometry, report

PHYSICS, TARGET = keys.diagnostics("physics"), keys.diagnostics("target")


@pytest.fixture
def drawing(tmp_path):
    return Drawing(tmp_path)


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


def test_health_has_the_newest_values_of_all_services(tmp_path):
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


def test_errors_are_plotted_true_and_as_estimated(drawing):
    robot = odometry(Pose2D(-1.2, 0.0, 0.1))
    drawing.put(keys.GROUND_TRUTH, robot)
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D()))
    drawing.put(keys.ODOM, robot)
    drawing.put(keys.FOLLOWER_STATE, following(Pose2D(0.1), Pose2D(-0.9)), 100)
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D()), 200)
    content = drawing.end()
    # the goal is 1 m behind the estimate, the robot 1.2 m behind the true person
    before, reported = content.all(layout.DISTANCE, "Scalars:scalars")
    assert math.isnan(before[2])
    assert before[3] == pytest.approx(0.2)
    assert reported[-2:] == pytest.approx((0.25, 0.2))
    angles = math.degrees(0.5), math.degrees(0.1)
    assert content.plotted(layout.ANGLE)[-2:] == pytest.approx(angles)
