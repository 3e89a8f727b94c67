"""Perception: persons from joints and from legs, against poses that are known."""

import math

import pytest
from follower.rooms import legs, scan
from harness import SCENARIOS, Steps
from mecazen.geometry import Pose2D, wrap
from mecazen.keys import SCAN, SKELETONS
from mecazen.loading import load_scenario
from mecazen.messages import Header, LaserScan, Point, Skeleton, Skeletons
from mecazen.scan import clusters, ranges_of
from mecazen.skeleton import JOINTS
from mecazen_follower.measurement import NO_HEADING
from mecazen_follower.perception import (
    GAP_M,
    PAIR_STD_M,
    BodyNode,
    LegsNode,
    persons,
    pose_of,
)
from msgspec.structs import replace

STANDING = {
    "pelvis": (0.0, 0.0, 0.95),
    "spine": (0.0, 0.0, 1.2),
    "neck": (0.0, 0.0, 1.45),
    "left_hip": (0.0, 0.1, 0.95),
    "right_hip": (0.0, -0.1, 0.95),
    "left_shoulder": (0.0, 0.2, 1.4),
    "right_shoulder": (0.0, -0.2, 1.4),
}
ELSEWHERE = (0.1, 0.0, 0.5)


def skeleton(pose: Pose2D, hidden=(), std: float = 0.01) -> Skeleton:
    """Return the skeleton of who stands at a pose, in which some joints are hidden."""
    joints = []
    for name in JOINTS:
        x, y, z = STANDING.get(name, ELSEWHERE)
        placed = pose.compose(Pose2D(x, y))
        joints.append(Point(placed.x, placed.y, z))
    confidence = tuple(0 if name in hidden else 2 for name in JOINTS)
    return Skeleton(id="7", joints=tuple(joints), std=(std,) * len(JOINTS), confidence=confidence)


def test_noiseless_skeleton_gives_the_exact_pose():
    for yaw_deg, std in ((0.0, 0.01), (179.0, 0.01), (-135.0, 0.0)):
        pose = Pose2D(1.5, -0.4, math.radians(yaw_deg))
        estimate, covariance = pose_of(skeleton(pose, std=std))
        assert estimate.distance(pose) == pytest.approx(0.0, abs=1e-9)
        assert wrap(estimate.yaw - pose.yaw) == pytest.approx(0.0, abs=1e-12)
        assert covariance[0][0] > 0.0  # a tracker has a resolution


def test_hidden_joints_leave_less_certainty():
    pose = Pose2D(1.0, 2.0, 0.3)
    _, seen = pose_of(skeleton(pose))
    estimate, one_line = pose_of(skeleton(pose, ["left_shoulder"]))
    assert estimate.yaw == pytest.approx(0.3)
    assert one_line[2][2] > 2.0 * seen[2][2]
    assert one_line[0][0] == seen[0][0]
    # from aside the place is known and the heading is not
    (x, y, _), covariance = pose_of(skeleton(pose, ["left_hip", "left_shoulder"]))
    assert (x, y) == pytest.approx((1.0, 2.0))
    assert covariance[2][2] == NO_HEADING
    # behind one another, hips and shoulders have no direction
    assert pose_of(skeleton(pose, std=1.0))[1][2][2] == NO_HEADING
    assert pose_of(skeleton(pose, ["pelvis", "spine", "neck"])) is None


def clusters_of(scan):
    return clusters(scan, ranges_of(scan), GAP_M)


def scan_of(circles, walls=(), std=0.0):
    return scan(Pose2D(), circles, walls, beams=720, std=std)


@pytest.mark.parametrize("bearing_deg", [0.0, 180.0])
def test_two_legs_are_one_person_between_them(bearing_deg):
    place = Pose2D(yaw=math.radians(bearing_deg)).compose(Pose2D(1.5, 0.0))
    legs = [(place.x + 0.15, place.y + 0.1, 0.05), (place.x - 0.15, place.y - 0.1, 0.05)]
    ((pose, covariance),) = persons(clusters_of(scan_of(legs, std=0.01)))
    # noise of 10 mm on some ten beams, and what a leg's depth is taken for
    assert pose.distance(place) < 0.02
    assert covariance[0][0] == PAIR_STD_M**2
    assert covariance[2][2] == NO_HEADING


@pytest.mark.parametrize(
    "scan",
    [
        scan_of([], walls=[2.0]),
        scan_of([(3.0, 0.0, 0.5)]),
        replace(scan_of([]), ranges=(2.0,) * 720),
        scan_of([]),
        LaserScan(ranges=(), range_max=12.0),
    ],
    ids=["a wall", "a column of 1 m", "a round room", "nothing", "no beams"],
)
def test_other_things_than_legs_are_no_person(scan):
    assert persons(clusters_of(scan)) == []


HERE = Pose2D(1.0, 0.0, 0.2)


def test_the_nodes_answer_with_observations_in_base_link():
    scenario = load_scenario(SCENARIOS / "senses.toml")
    frame = Skeletons(header=Header(frame_id="base_link"), skeletons=(skeleton(HERE),))
    (seen,) = Steps(BodyNode, scenario).step(0, {SKELETONS: frame}).values()
    assert seen.ids == ("7",)
    assert seen.poses[0].pose.to_planar().distance(HERE) < 1e-9
    lidar_x = scenario.robot.lidar.position_m[0]
    scanned = {SCAN: scan(Pose2D(), legs(1.0, 0.0))}
    (found,) = Steps(LegsNode, scenario).step(0, scanned).values()
    assert found.header.frame_id == "base_link"
    assert found.poses[0].pose.position.x == pytest.approx(1.0 + lidar_x, abs=0.03)
