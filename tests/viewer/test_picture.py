"""What is shown of each message, and when."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
import numpy as np
import pytest
from harness import load_robot
from mecazen import messages as m
from mecazen.config import Scenario, WorldConfig
from mecazen.config.world import Patch, Ramp
from mecazen.covariance import diagonal_covariance
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS
from mecazen_viewer import entities as e
from mecazen_viewer.components import Components
from mecazen_viewer.entities import Entity
from mecazen_viewer.health import Health
from mecazen_viewer.layout import application, blueprint
from mecazen_viewer.picture import Picture, surroundings
from mecazen_viewer.plots import LINES, TIME_LINES
from viewer_stage import values

MS = 10**6
POINTS = e.OBSERVATION, "Points3D:positions"
COVARIANCE = diagonal_covariance((0.01, 0.01, 0.0, 0.0, 0.0, 0.04))
SEEN = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), COVARIANCE)


def picture() -> Picture:
    return Picture(Scenario(robot=load_robot()), Health())


def odometry(pose: Pose2D) -> m.Odometry:
    return m.planar_odometry(m.Time(), "world", "base_link", pose, Twist2D())


def scalars(entities: Mapping[str, Components], path: str) -> np.ndarray:
    """The newest values of a plot."""
    return values(entities, path, "Scalars:scalars")


def place(entities: Iterable[Entity], path: str) -> Pose2D:
    """The planar pose of a frame."""
    logged = dict(entities)
    x, y, _ = values(logged, path, "Transform3D:translation")[0]
    _, _, z, w = values(logged, path, "Transform3D:quaternion")[0]
    return Pose2D(x, y, 2.0 * math.atan2(z, w))


def following(estimate: Pose2D, goal: Pose2D, tracking: str = "following") -> m.FollowerState:
    pose = m.PoseWithCovariance(pose=m.Pose.planar(estimate), covariance=COVARIANCE)
    return m.FollowerState(
        tracking=tracking,
        estimate=(m.Odometry(pose=pose),),
        goal=(m.Pose.planar(goal),),
        distance_error=0.25,
        heading_error=0.5,
    )


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


def test_errors_are_true_and_as_the_follower_has_them():
    shown = picture()
    list(shown.on_ground_truth(odometry(Pose2D(-1.2, 0.0, 0.1)), 0))
    list(shown.on_target_odom(odometry(Pose2D()), 0))
    list(shown.on_odom(odometry(Pose2D(-1.2, 0.0, 0.1)), 0))
    entities = dict(shown.on_follower_state(following(Pose2D(0.1), Pose2D(-0.9)), 0))
    # the goal is 1 m behind the estimate, the robot 1.2 m behind the true person
    *_, reference, estimated, true = scalars(entities, e.DISTANCE)
    assert (reference, estimated, true) == pytest.approx((0.0, 0.25, 0.2))
    *_, reference, estimated, true = scalars(entities, e.ANGLE)
    assert (reference, estimated, true) == pytest.approx(
        (0.0, math.degrees(0.5), math.degrees(0.1))
    )
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


def physics_says(rtf: str, level: int = 0, message: str = "ok") -> m.DiagnosticArray:
    status = m.DiagnosticStatus(
        level=level, name="physics", message=message, values=(m.KeyValue(key="rtf", value=rtf),)
    )
    return m.DiagnosticArray(status=(status,))


def test_tracking_and_health_are_logged_when_they_change():
    shown = picture()
    lines = []
    for entities in (
        shown.on_follower_state(m.FollowerState(tracking="waiting"), 0),
        shown.on_follower_state(m.FollowerState(tracking="waiting"), 0),
        shown.on_follower_state(following(Pose2D(), Pose2D(), "coasting"), 0),
        shown.on_diagnostics(physics_says("1.0"), 0, "physics"),
        shown.on_diagnostics(physics_says("1.1"), 0, "physics"),
        shown.on_diagnostics(physics_says("1.2", 1, "refused payloads"), 0, "physics"),
    ):
        for path, archetype in entities:
            if path.startswith(f"{e.LOG}/"):
                (text,) = archetype.text.as_arrow_array().to_pylist()
                (level,) = archetype.level.as_arrow_array().to_pylist()
                lines.append(f"{level} {text}")
    assert lines == [
        "INFO tracking: waiting",
        "WARN tracking: coasting",
        "INFO physics: ok",
        "WARN physics: refused payloads",
    ]


def test_of_several_robots_health_and_tracking_are_told_with_their_names():
    health, scenario = Health(), Scenario(robot=load_robot())
    pictures = [Picture(scenario, health, robot) for robot in ("", "one", "two")]
    report = m.DiagnosticArray(status=(m.DiagnosticStatus(name="follower", message="ok"),))
    lines = []
    for shown in pictures[1:]:
        tracking = shown.on_follower_state(m.FollowerState(tracking="lost"), 0)
        said = [*tracking, *shown.on_diagnostics(report, 0, "follower")]
        lines += [text.text.as_arrow_array()[0].as_py() for path, text in said if path != e.HEALTH]
    assert lines == [
        f"{robot}/{line}" for robot in ("one", "two") for line in ("tracking: lost", "follower: ok")
    ]
    shown = dict(pictures[0].on_diagnostics(physics_says("1.0"), 0, "physics"))[e.HEALTH]
    (text,) = shown.text.as_arrow_array().to_pylist()
    names = [paragraph.split()[0] for paragraph in text.split("\n\n")]
    assert names == ["**one/follower**", "**physics**", "**two/follower**"]


def test_health_is_the_newest_of_the_newest_of_every_service_in_four_digits():
    shown = picture()
    list(shown.on_diagnostics(physics_says("0.123456"), 0, "physics"))
    text_shown = dict(shown.on_diagnostics(physics_says("0.987654"), 0, "physics"))[e.HEALTH]
    (text,) = text_shown.text.as_arrow_array().to_pylist()
    assert "**physics** ok: rtf 0.9877" in text
    assert "0.1235" not in text


def test_what_a_stranger_says_is_text_in_the_table_and_counts_under_the_name_of_its_key():
    value = m.KeyValue(key="[x](http://y)", value="a | <b> \x1b[2J\n| physics | ok |")
    status = m.DiagnosticStatus(level=1, name="physics", message="\x1b]0;", values=(value,))
    drawn = list(picture().on_diagnostics(m.DiagnosticArray(status=(status,)), 0, "viewer"))
    (path, line), (_, table) = drawn
    assert path == f"{e.LOG}/viewer"
    assert line.text.as_arrow_array().to_pylist() == ["viewer: \\u001b]0;"]
    text = table.text.as_arrow_array()[0].as_py()
    shown = r"\[x\]\(http://y\) a \| \<b\> \\u001b\[2J\\n\| physics \| ok \|"
    assert text == f"**viewer** warning: {shown}"


def test_the_grid_is_laid_anew_only_when_the_robot_has_gone_far():
    shown = picture()
    assert list(shown.ground()) == []
    laid = []
    for x in (0.0, 1.0, 4.0, 12.0, 13.0):
        list(shown.on_ground_truth(odometry(Pose2D(x)), 0))
        laid.append(len(list(shown.ground())))
    assert laid == [1, 0, 0, 1, 0]


def origins(part: Any) -> set[str]:
    """Where the views of a part of the layout begin."""
    if hasattr(part, "origin"):
        return {part.origin}
    return set().union(*(origins(child) for child in part.contents))


def test_the_layout_shows_every_plot_and_text_there_is():
    shown = origins(blueprint(("",)).root_container)
    assert {e.FOLLOW, e.HEALTH, e.LOG} <= shown
    for path in LINES | TIME_LINES:
        assert any(path == origin or path.startswith(f"{origin}/") for origin in shown)


def test_each_of_several_robots_has_a_tab_with_what_a_single_one_has():
    single = origins(blueprint(("",)).root_container)
    tabs = blueprint(("one", "two")).root_container.contents
    assert [tab.name for tab in tabs] == ["one", "two"]
    for tab in tabs:
        assert origins(tab) == {
            path if path == e.REAL_TIME else e.of_robot(path, tab.name) for path in single
        }
    # what a user has made of the layout of one is not taken for that of others
    assert len({application(robots) for robots in (("",), ("one",), ("one", "two"))}) == 3


def test_what_several_robots_have_is_below_their_names_and_what_they_share_is_not():
    assert e.of_robot(e.GOAL, "two") == "world/two/odom/goal"
    assert e.of_robot(e.DISTANCE, "two") == "plots/two/distance"
    assert e.of_robot(e.HEALTH, "two") == e.HEALTH
    assert e.of_robot(e.GOAL, "") == e.GOAL


def test_walkers_are_shown_by_their_bones_or_as_tall_as_they_are_and_who_is_followed_is_not():
    walker = m.Person("walker_1", m.Pose.planar(Pose2D(1.0, 2.0)), height=1.7)
    ((path, _),) = picture().on_people(m.People(persons=(m.Person("target"), walker)), 0)
    assert path == e.PEOPLE
    far = msgspec.structs.replace(walker, pose=m.Pose.planar(Pose2D(1e9)))
    with pytest.raises(ValueError, match="out of range"):
        list(picture().on_people(m.People(persons=(far,)), 0))


def test_a_ramp_stands_with_its_top_at_its_height_and_a_patch_is_outlined():
    ramp = Ramp(length_m=1.0, width_m=0.8, rise_m=0.08, position_m=(3.0, 0.0), heading_deg=90.0)
    patch = Patch(size_m=(2.0, 1.0), position_m=(1.0, 1.0), friction=0.3)
    world = WorldConfig(ramps=(ramp,), patches=(patch,))
    shown = dict(surroundings(Scenario(robot=load_robot(), world=world)))
    corners = np.array(shown[f"{e.RIDGES}/0"].vertex_positions.as_arrow_array().to_pylist())
    assert corners.min(axis=0) == pytest.approx((2.6, -1.5, 0.0), abs=1e-6)
    assert corners.max(axis=0) == pytest.approx((3.4, 1.5, 0.08), abs=1e-6)
    assert f"{e.PATCHES}/0" in shown
    assert f"{e.OBSTACLES}/1" in shown  # its rails
