"""Persons from joints: against poses that are known."""

import math

import numpy as np
import pytest
from follower.skeletons import skeleton
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import Point, Skeleton
from mecazen.skeleton import JOINTS
from mecazen_follower.measurement import NO_HEADING
from mecazen_follower.perception.body import pose_of


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 179.0, -135.0])
def test_a_body_without_noise_stands_where_it_stands_and_faces_where_it_faces(yaw_deg):
    pose = Pose2D(1.5, -0.4, math.radians(yaw_deg))
    found, _ = pose_of(skeleton(pose))
    assert found.distance(pose) == pytest.approx(0.0, abs=1e-12)
    assert wrap(found.yaw - pose.yaw) == pytest.approx(0.0, abs=1e-12)


def test_a_hidden_shoulder_leaves_the_hips_and_more_doubt():
    pose = Pose2D(1.0, 0.0, 0.3)
    (_, seen), (found, hidden) = pose_of(skeleton(pose)), pose_of(skeleton(pose, ["left_shoulder"]))
    assert found.yaw == pytest.approx(0.3)
    assert hidden[2][2] > 2.0 * seen[2][2]
    assert hidden[0][0] == seen[0][0]


def test_of_a_body_from_aside_the_place_is_known_and_the_heading_is_not():
    far = [f"{side}_{joint}" for side in ("left",) for joint in ("hip", "shoulder")]
    (x, y, _), covariance = pose_of(skeleton(Pose2D(1.0, 2.0, 0.3), far))
    assert (x, y) == pytest.approx((1.0, 2.0))
    assert covariance[2][2] == NO_HEADING


def test_a_body_whose_trunk_is_out_of_view_is_nowhere():
    assert pose_of(skeleton(Pose2D(), ["pelvis", "spine", "neck"])) is None


def test_a_tracker_that_claims_to_have_no_error_is_taken_at_its_resolution():
    pose = Pose2D(1.0, 0.0, 0.3)
    found, covariance = pose_of(skeleton(pose, std=0.0))
    assert found.distance(pose) < 1e-9
    assert covariance[0][0] > 0.0


def test_noise_of_the_joints_is_no_more_than_the_covariance_says():
    random, pose, std = np.random.default_rng(1), Pose2D(1.0, 0.0, 0.5), 0.02
    errors = []
    for _ in range(500):
        body = skeleton(pose, std=std)
        noise = std * random.standard_normal((len(JOINTS), 3))
        moved = tuple(
            Point(joint.x + dx, joint.y + dy, joint.z + dz)
            for joint, (dx, dy, dz) in zip(body.joints, noise, strict=True)
        )
        seen = Skeleton(id="7", joints=moved, std=body.std, confidence=body.confidence)
        found, covariance = pose_of(seen)
        error = np.array([found.x - 1.0, found.y, wrap(found.yaw - 0.5)])
        errors.append(error**2 / np.diag(covariance))
    # white noise alone is less than what lasts for many frames, for which there is room
    assert (np.mean(errors, axis=0) < 1.0).all()
