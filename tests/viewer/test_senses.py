"""Observations of sensors, and bodies, as shapes."""

import math

import msgspec
import pytest
from mecazen import messages as m
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen.skeleton import JOINTS
from mecazen_viewer import entities as e
from mecazen_viewer import senses
from viewer.pictures import picture
from viewer_stage import values


def test_walkers_are_shown_by_their_bones_or_as_tall_as_they_are_and_who_is_followed_is_not():
    walker = m.Person("walker_1", m.Pose.planar(Pose2D(1.0, 2.0)), height=1.7)
    ((path, _),) = picture().on_people(m.People(persons=(m.Person("target"), walker)), 0)
    assert path == e.PEOPLE
    far = msgspec.structs.replace(walker, pose=m.Pose.planar(Pose2D(1e9)))
    with pytest.raises(RefusedError, match="out of range"):
        list(picture().on_people(m.People(persons=(far,)), 0))


def test_a_scan_is_shown_where_the_lidar_saw_it_and_only_what_is_in_its_range():
    scan = m.LaserScan(
        angle_min=-math.pi / 2,
        angle_increment=math.pi / 2,
        range_min=0.1,
        range_max=10.0,
        ranges=(1.0, 2.0, 11.0),
    )
    robot = Pose2D(1.0, 2.0, math.pi / 2)
    path, shown = senses.scan(scan, (0.5, 0.0, 0.3), robot)
    # the lidar is at (1, 2.5), and looks along y: to its right is x
    points = values({path: shown}, e.SCAN, "Points3D:positions")
    assert points.ravel() == pytest.approx([2.0, 2.5, 0.3, 1.0, 4.5, 0.3], abs=1e-6)


def test_a_bone_is_seen_that_has_both_its_joints_in_view():
    joints = tuple(m.Point(0.1 * number, 0.0, 1.0) for number in range(len(JOINTS)))

    def bones(*confidence):
        seen = m.Skeleton(joints=joints, confidence=confidence)
        path, shown = senses.skeletons((seen,), Pose2D(1.0))
        return len(values({path: shown}, e.SKELETON, "LineStrips3D:strips"))

    assert bones() == len(JOINTS) - 1  # a tree
    assert bones(*[0] * len(JOINTS)) == 0
    with pytest.raises(RefusedError, match="joints, not 1"):
        senses.body(m.Skeleton(joints=joints[:1]))


@pytest.mark.parametrize(("encoding", "size"), [("rgb8", 12), ("16UC1", 11)])
def test_a_depth_picture_of_another_size_or_kind_is_refused(encoding, size):
    assert senses.depth(m.Image(width=3, height=2, encoding="16UC1", data=bytes(12)))[0] == e.DEPTH
    with pytest.raises(RefusedError, match=f"{size} bytes"):
        senses.depth(m.Image(width=3, height=2, encoding=encoding, data=bytes(size)))
