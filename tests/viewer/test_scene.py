"""Messages in, and what the recording has of the scene, its robots, plots, log and health."""

import math
from typing import Any

import numpy as np
import pytest
from mecazen import keys, urdf
from mecazen import messages as m
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import JointState, ros_covariance
from mecazen.skeleton import JOINTS
from mecazen_viewer import layout
from mecazen_viewer.robot import RobotModel
from viewer.drawing import COVARIANCE, Drawing, following, odometry, report
from viewer.toy import URDF

DETECTION = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), COVARIANCE)
POINTS, STRIPS = "Points3D:positions", "LineStrips3D:strips"
STRETCH = "Transform3D:mat3x3"
BODY = tuple(m.Point(0.1 * number, 0.0, 1.0) for number in range(len(JOINTS)))


@pytest.fixture
def drawing(tmp_path):
    return Drawing(tmp_path)


def test_view_and_odom_frame_follow_the_true_robot(drawing):
    truth, drifted = Pose2D(1.0, 2.0, 0.5), Pose2D(0.7, 2.2, 0.4)
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D(3.0, 2.0)))
    drawing.put(keys.GROUND_TRUTH, odometry(truth))
    drawing.put(keys.ODOM, odometry(drifted))
    content = drawing.end()
    assert content.pose(layout.ROBOT) == pytest.approx(truth, abs=1e-6)
    assert content.pose(layout.FOLLOW) == pytest.approx((2.0, 2.0, 0.0), abs=1e-6)
    assert content.pose(layout.ODOM).compose(drifted) == pytest.approx(truth, abs=1e-6)


def test_added_obstacles_are_drawn_until_they_are_removed(drawing):
    crate = "crate", '{kind="box", size_m=[0.4, 0.6, 1.0], position_m=[2.0, 1.0]}'
    pillar = "pillar", '{kind="cylinder", size_m=[0.1, 2.0], position_m=[0.0, 1.0]}'
    for ms, things in ((10, [crate]), (20, [crate, pillar]), (30, [pillar])):
        changes = tuple(m.Parameter(f"world.added.{name}", value) for name, value in things)
        drawing.put(keys.PARAMETERS, m.Parameters(parameters=changes), ms)
    content = drawing.end()
    paths = [f"{layout.ADDED}/{name}" for name in ("crate", "pillar")]
    assert content.all(paths[0], "Boxes3D:centers")[0] == pytest.approx(np.array([[2.0, 1.0, 0.5]]))
    assert len(content.all(paths[0], "Clear:is_recursive")) == 1
    assert len(content.all(paths[1], "Cylinders3D:centers")) == 1
    assert f"{paths[1]}" in content.paths
    assert content.all(paths[1], "Clear:is_recursive") == []


def test_observation_uses_the_pose_at_capture(drawing):
    for tick in range(5):
        pose = Pose2D(y=0.1 * tick, yaw=math.pi / 2)
        drawing.put(keys.GROUND_TRUTH, odometry(pose), 40 * tick)
    frame = m.Observation(m.Header(m.Time.from_ns(80 * 10**6), "base_link"), (DETECTION,))
    drawing.put(keys.OBSERVATION, frame, 160)
    content = drawing.end()
    # 1 m ahead of a robot at y = 0.2 m that looks along y
    assert content.last(layout.OBSERVATION, POINTS)[0][:2] == pytest.approx((0.0, 1.2), abs=1e-6)


def test_scan_is_drawn_within_its_range(drawing):
    scan = m.LaserScan(
        angle_min=-math.pi / 2,
        angle_increment=math.pi / 2,
        range_min=0.1,
        range_max=10.0,
        ranges=(1.0, 2.0, 11.0),
    )
    drawing.put(keys.GROUND_TRUTH, odometry(Pose2D(1.0, 2.0, math.pi / 2)))
    drawing.put(keys.SCAN, scan)
    ahead, left, up = drawing.viewer.scenario.robot.lidar.position_m
    x, y = 1.0 - left, 2.0 + ahead  # the robot looks along y: to its right is x
    points = drawing.end().last(layout.SCAN, POINTS)
    assert points == pytest.approx(np.array([[x + 1.0, y, up], [x, y + 2.0, up]]), abs=1e-6)


@pytest.mark.parametrize("frame_id", ["world", "base_link"])
def test_ellipse_contains_95_percent_in_each_frame(drawing, frame_id):
    spread = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 1.0]])
    pose = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), ros_covariance(spread.tolist()))
    drawing.put(keys.GROUND_TRUTH, odometry(Pose2D(yaw=math.pi / 2)))
    drawing.put(keys.OBSERVATION, m.Observation(m.Header(frame_id=frame_id), (pose,)))
    (columns,) = drawing.end().last(layout.OBSERVATION_ELLIPSE, STRETCH)
    axes = columns.reshape(3, 3).T[:2, :2]
    # squared Mahalanobis distances have two degrees of freedom: the 95 % quantile is 5.991
    turned = spread[:2, :2]
    if frame_id == "base_link":  # a quarter turn exchanges the axes and the sign of xy
        turned = np.array([[0.09, -0.01], [-0.01, 0.04]])
    assert axes @ axes.T == pytest.approx(5.991 * turned, abs=1e-3)


def test_trail_has_a_minute_and_restarts_at_jumps(drawing):
    for tick in range(1001):
        drawing.put(keys.ODOM, odometry(Pose2D(tick / 100)), 100 * tick)
    drawing.put(keys.ODOM, odometry(Pose2D(20.0)), 100_200)
    *_, (trail,), (restarted,) = drawing.end().all(f"{layout.TRAILS}/odometry", STRIPS)
    assert (trail[0][0], trail[-1][0]) == pytest.approx((4.0, 10.0))
    assert [point[0] for point in restarted] == [20.0]


def image(encoding: str, size: int) -> m.Image:
    return m.Image(width=3, height=2, encoding=encoding, data=bytes(size))


@pytest.mark.parametrize(
    ("topic", "wrong"),
    [
        (keys.TARGET_SKELETON, m.Skeleton(joints=BODY[:1])),
        (keys.SKELETONS, m.Skeletons(skeletons=(m.Skeleton(joints=BODY, confidence=(1,)),))),
        (keys.DEPTH, image("rgb8", 12)),
        (keys.DEPTH, image("16UC1", 11)),
    ],
)
def test_message_that_cannot_be_drawn_is_refused(drawing, topic, wrong):
    drawing.put(keys.GROUND_TRUTH, odometry(Pose2D()))
    drawing.put(keys.DEPTH, image("16UC1", 12))
    drawing.put(topic, wrong, 100)
    assert drawing.bus.refused == {topic.key: 1}
    assert len(drawing.end().all(layout.DEPTH, "DepthImage:buffer")) == 1


def test_invalid_covariance_is_drawn_as_a_dot(drawing):
    spread = [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    pose = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), ros_covariance(spread))
    drawing.put(keys.OBSERVATION, m.Observation(m.Header(frame_id="world"), (pose,)))
    (columns,) = drawing.end().last(layout.OBSERVATION_ELLIPSE, STRETCH)
    assert np.abs(columns[:2]).max() < 0.01


PHYSICS, TARGET = keys.diagnostics("physics"), keys.diagnostics("target")


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


BASE, WHEEL, ROLLERS, MAST = (
    f"world/robot/{name}" for name in ("base_link", "wheel", "roller_0", "mast")
)
PLACES, TURNS = (f"InstancePoses3D:{name}" for name in ("translations", "quaternions"))


def values(entities: dict[str, Any], path: str, component: str) -> np.ndarray:
    """Return the logged values of a component of a path."""
    batches = entities[path].as_component_batches()
    logged = {str(batch.component_descriptor()): batch for batch in batches}
    return np.array(logged[component].as_arrow_array().to_pylist())


def states(**angles: float) -> JointState:
    return JointState(name=tuple(angles), position=tuple(angles.values()))


def test_links_are_placed_by_all_joints():
    model = RobotModel(urdf.read(URDF), {"meshes/r.stl": b""})
    posed = dict(model.pose(states(wheel_joint=math.pi / 2, r0=math.pi / 2, other=9.0)))
    assert set(posed) == {path for path, _ in model.shapes} == {BASE, WHEEL, ROLLERS, MAST}
    # single precision
    near = {"abs": 1e-6}
    assert values(posed, BASE, PLACES)[0] == pytest.approx([0, 0, 0.1])
    assert values(posed, MAST, PLACES)[0] == pytest.approx([0.3, 0, 1])
    assert values(posed, WHEEL, PLACES) == pytest.approx(np.array([[0.1, 0.2, 0.05]]), **near)
    # the cylinder lies in its link by 1.5 rad about x, and the link is turned about y
    h = math.sqrt(0.5)
    a, b = h * math.sin(0.75), h * math.cos(0.75)
    assert values(posed, WHEEL, TURNS) == pytest.approx(np.array([[a, b, -a, b]]), **near)
    # a wheel that has turned a quarter about y has what was below it behind, and above it before
    places = np.array([[0.06, 0.2, 0.05], [0.14, 0.2, 0.05]])
    assert values(posed, ROLLERS, PLACES) == pytest.approx(places, **near)
    # a quarter about y after a quarter about z: of the joint's angle, and of the second's origin
    turned = np.array([[0.5, 0.5, 0.5, 0.5]] * 2)
    assert values(posed, ROLLERS, TURNS) == pytest.approx(turned, **near)


def test_a_wrong_description_is_refused():
    with pytest.raises(RefusedError, match=r"r\.stl"):
        RobotModel(urdf.read(URDF), {})
    cycle = "<joint><parent link='a'/><child link='a'/></joint>"
    with pytest.raises(RefusedError, match="cycle"):
        RobotModel(urdf.read(f"<robot>{cycle}</robot>"), {})
