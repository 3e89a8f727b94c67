"""The scene: messages in, and where the recording has robot, person, estimates and sensors."""

import math

import numpy as np
import pytest
from harness import SCENARIOS, load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Scenario, WorldConfig
from mecazen.config.world import Patch, Ramp
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.messages import ros_covariance
from mecazen.skeleton import INDEX, JOINTS, LIMBS
from mecazen_viewer import layout
from msgspec.structs import replace
from viewer.drawing import Drawing, following, odometry
from viewer_stage import COVARIANCE

DETECTION = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), COVARIANCE)
POINTS, STRIPS = "Points3D:positions", "LineStrips3D:strips"
STRETCH = "Transform3D:mat3x3"


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


def test_a_robot_without_sensors_is_drawn(tmp_path):
    blind = Drawing(tmp_path, Scenario(robot=replace(load_robot(), camera=None, lidar=None)))
    blind.put(keys.GROUND_TRUTH, odometry(Pose2D(1.0)))
    assert blind.end().pose(layout.ROBOT).x == pytest.approx(1.0)


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


def test_observation_is_drawn_from_the_pose_at_its_capture(drawing):
    for tick in range(5):
        pose = Pose2D(y=0.1 * tick, yaw=math.pi / 2)
        drawing.put(keys.GROUND_TRUTH, odometry(pose), 40 * tick)
    frame = m.Observation(m.Header(m.Time.from_ns(80 * 10**6), "base_link"), (DETECTION,))
    drawing.put(keys.OBSERVATION, frame, 160)
    content = drawing.end()
    # 1 m ahead of a robot at y = 0.2 m that looks along y
    assert content.last(layout.OBSERVATION, POINTS)[0][:2] == pytest.approx((0.0, 1.2), abs=1e-6)


@pytest.mark.parametrize("frame_id", ["world", "base_link"])
def test_ellipse_contains_95_percent_and_turns_with_its_frame(drawing, frame_id):
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


@pytest.mark.parametrize(
    "spread",
    [
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1e300, 1e300, 1e300]),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ],
)
def test_invalid_covariance_is_drawn_as_a_dot(drawing, spread):
    pose = m.PoseWithCovariance(m.Pose.planar(Pose2D(1.0)), ros_covariance(spread.tolist()))
    drawing.put(keys.OBSERVATION, m.Observation(m.Header(frame_id="world"), (pose,)))
    (columns,) = drawing.end().last(layout.OBSERVATION_ELLIPSE, STRETCH)
    assert np.abs(columns[:2]).max() < 0.01


def test_observations_disappear_one_by_one(drawing):
    frame, nothing = m.Observation(m.Header(frame_id="world"), (DETECTION,)), m.Observation()
    for step, message in enumerate((frame, frame, nothing, nothing, nothing)):
        drawing.put(keys.OBSERVATION, message, 100 * step)
    counts = [len(points) for points in drawing.end().all(layout.OBSERVATION, POINTS)]
    assert counts == [1, 2, 1, 0, 0]


def test_marks_are_drawn_with_their_first_place_only(drawing):
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D(3.0)))
    drawing.put(keys.CMD_VEL, m.Twist(), 100)
    marks = {f"{layout.ESTIMATE}/arrow", f"{layout.GOAL}/outline", f"{layout.PERSON}/arrow"}
    assert drawing.end().paths & marks == {f"{layout.PERSON}/arrow"}


def test_estimate_goal_and_ellipse_have_marks(drawing):
    for ms in (0, 100):
        drawing.put(keys.FOLLOWER_STATE, following(Pose2D(), Pose2D(-0.9)), ms)
    content = drawing.end()
    assert content.pose(layout.GOAL) == pytest.approx((-0.9, 0.0, 0.0), abs=1e-6)
    for frame in (layout.ESTIMATE, layout.GOAL):
        assert len(content.all(f"{frame}/arrow", "Arrows3D:vectors")) == 1
    assert len(content.all(f"{layout.ESTIMATE_ELLIPSE}/outline", STRIPS)) == 1


def test_grid_moves_only_when_the_robot_has_gone_far(drawing):
    for step, x in enumerate((0.0, 1.0, 4.0, 12.0, 13.0)):
        drawing.put(keys.GROUND_TRUTH, odometry(Pose2D(x)), 100 * step)
    assert len(drawing.end().all(layout.GROUND, STRIPS)) == 2


def test_trail_has_five_points_a_second_of_the_last_minute(drawing):
    for tick in range(1001):
        drawing.put(keys.ODOM, odometry(Pose2D(tick / 100)), 100 * tick)
    trails = drawing.end().all(f"{layout.TRAILS}/odometry", STRIPS)
    assert len(trails) == 501
    (trail,) = trails[-1]
    assert len(trail) == 301
    assert trail[0][:2] == pytest.approx((4.0, 0.0))


def test_jump_starts_a_new_trail(drawing):
    for step, x in enumerate((0.0, 0.5, 7.0)):
        drawing.put(keys.ODOM, odometry(Pose2D(x)), 1000 * step)
    (trail,) = drawing.end().last(f"{layout.TRAILS}/odometry", STRIPS)
    assert [point[0] for point in trail] == [7.0]


def walked(drawing: Drawing, period_ms: int) -> np.ndarray:
    """The ends of limbs (N, limbs, 2, 3) of a person who walks along x at 0.8 m/s for 4 s."""
    for ms in range(0, 4001, period_ms):
        drawing.put(keys.TARGET_ODOM, odometry(Pose2D(0.8 * ms / 1e3), speed=0.8), ms)
    return np.array(drawing.end().all(layout.BODY, STRIPS))


def test_person_without_published_joints_walks(drawing):
    limbs = walked(drawing, 40)
    assert limbs.shape == (101, len(LIMBS) + 2, 2, 3)  # neck and shoulders
    heights = limbs[-1, ..., 2]
    assert heights.max() - heights.min() == pytest.approx(1.65, abs=0.1)  # sole to mid-head
    shanks = [i for i, limb in enumerate(LIMBS) if limb.name.endswith("shank")]
    assert JOINTS[INDEX[LIMBS[shanks[0]].end]].endswith("ankle")
    for shank in shanks:
        moved_m = np.diff(limbs[50:, shank, 1, 0])
        # the ankle of a flat foot stands still; in swing it overtakes a body that moves by 3.2 cm
        assert moved_m.min() < 1e-3
        assert moved_m.max() > 2 * 0.8 * 0.04


def test_low_frame_rate_shows_the_same_steps(tmp_path):
    folders = [tmp_path / name for name in ("slow", "fast")]
    for folder in folders:
        folder.mkdir()
    slow, fast = walked(Drawing(folders[0]), 320), walked(Drawing(folders[1]), 40)[::8]
    assert slow == pytest.approx(fast[: len(slow)], abs=1e-6)  # single precision


def test_published_joints_are_drawn_as_limbs(drawing):
    joints = tuple(m.Point(0.1 * number, 0.0, 1.0) for number in range(len(JOINTS)))
    drawing.put(keys.TARGET_SKELETON, m.Skeleton(joints=joints))
    drawing.put(keys.TARGET_SKELETON, m.Skeleton(joints=joints[:1]), 100)
    assert drawing.bus.refused == {"target/skeleton": 1}
    assert len(drawing.end().last(layout.BODY, STRIPS)) == len(LIMBS) + 2


def test_bones_are_drawn_between_joints_in_view(drawing):
    joints = tuple(m.Point(0.1 * number, 0.0, 1.0) for number in range(len(JOINTS)))
    drawing.put(keys.GROUND_TRUTH, odometry(Pose2D(1.0)))
    hidden = (0, *(2,) * (len(JOINTS) - 1))
    for step, confidence in enumerate(((), hidden, (0,) * len(JOINTS), (1,))):
        seen = m.Skeletons(skeletons=(m.Skeleton(joints=joints, confidence=confidence),))
        drawing.put(keys.SKELETONS, seen, 100 * step)
    assert drawing.bus.refused.total() == 1  # a confidence for one joint of 20
    # a tree; the pelvis, which is out of view, has three neighbours
    assert [len(bones) for bones in drawing.end().all(layout.SKELETON, STRIPS)] == [19, 16, 0]


def test_pedestrians_are_drawn_unless_a_robot_follows_them(drawing):
    walker = m.Person("walker_1", m.Pose.planar(Pose2D(1.0, 2.0)), height=1.7)
    far = m.Person("far", m.Pose.planar(Pose2D(1e9)), height=1.7)
    drawing.put(keys.PEOPLE, m.People(persons=(m.Person("target"), walker)))
    drawing.put(keys.PEOPLE, m.People(persons=(far,)), 100)
    assert drawing.bus.refused == {"people": 1}
    limbs = np.array(drawing.end().last(layout.PEOPLE, STRIPS))
    assert len(limbs) == len(LIMBS) + 2  # one body, with neck and shoulders
    # who stands does so round the place of their pose, with the head 1.6 m above it
    assert limbs[..., :2].mean(axis=(0, 1)) == pytest.approx((1.0, 2.0), abs=0.1)
    assert limbs[..., 2].max() == pytest.approx(1.6, abs=0.1)


def test_scan_is_drawn_from_the_lidar_within_its_range(drawing):
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


def test_depth_picture_of_wrong_size_or_encoding_is_refused(drawing):
    pictures = ("16UC1", 12), ("rgb8", 12), ("16UC1", 11)
    for step, (encoding, size) in enumerate(pictures):
        image = m.Image(width=3, height=2, encoding=encoding, data=bytes(size))
        drawing.put(keys.DEPTH, image, 100 * step)
    assert drawing.bus.refused.total() == 2
    assert len(drawing.end().all(layout.DEPTH, "DepthImage:buffer")) == 1


def test_ramps_rails_and_patches_are_in_the_scene(tmp_path):
    ramp = Ramp(length_m=1.0, width_m=0.8, rise_m=0.08, position_m=(3.0, 0.0), heading_deg=90.0)
    patch = Patch(size_m=(2.0, 1.0), position_m=(1.0, 1.0), friction=0.3)
    world = WorldConfig(ramps=(ramp,), patches=(patch,))
    drawing = Drawing(tmp_path, Scenario(robot=load_robot(), world=world))
    drawing.put(keys.TARGET_ODOM, odometry(Pose2D()))
    content = drawing.end()
    corners = content.last(f"{layout.RIDGES}/0", "Mesh3D:vertex_positions")
    assert corners.min(axis=0) == pytest.approx((2.6, -1.5, 0.0), abs=1e-6)
    assert corners.max(axis=0) == pytest.approx((3.4, 1.5, 0.08), abs=1e-6)
    (outline,) = content.last(f"{layout.PATCHES}/0", STRIPS)
    assert np.ptp(outline[:, :2], axis=0) == pytest.approx((2.0, 1.0))
    assert len(content.last(f"{layout.OBSTACLES}/boxes", "Boxes3D:centers")) == 2  # rails


def test_the_cameras_view_is_drawn_where_the_scenario_has_a_camera(tmp_path):
    for name, expected in (("crowd", {layout.FRUSTUM}), ("back", set())):
        drawing = Drawing(tmp_path, load_scenario(SCENARIOS / f"{name}.toml"))
        drawing.put(keys.TARGET_ODOM, odometry(Pose2D()))
        assert drawing.end().paths & {layout.FRUSTUM} == expected
