from __future__ import annotations

from xml.etree import ElementTree as ET

import dartpy as dart
import msgspec
import numpy as np
import pytest
from mecazen.robot import Robot
from mecazen.urdf import build_meshes, build_urdf
from physics_rig import Rig


@pytest.fixture
def tree(robot: Robot) -> ET.Element:
    return ET.fromstring(build_urdf(robot))  # noqa: S314 - our own text


def test_moving_joints_are_those_of_the_world_in_its_order(tree, robot):
    moving = [joint.get("name") for joint in tree.iter("joint") if joint.get("type") != "fixed"]
    assert tuple(moving) == Rig(robot).joint_names
    fixed = [joint.get("name") for joint in tree.iter("joint") if joint.get("type") == "fixed"]
    assert fixed == ["camera_joint", "lidar_joint", "camera_depth_optical_joint"]


def test_masses_sum_up_to_the_robot_files(tree, robot):
    total = sum(float(mass.get("value", "nan")) for mass in tree.iter("mass"))
    wheel = robot.wheels.hub_mass_kg + robot.rollers.count * robot.rollers.mass_kg
    expected = robot.base.mass_kg + 4 * wheel + robot.camera.mass_kg + robot.lidar.mass_kg
    assert total == pytest.approx(expected, rel=1e-12)


def test_one_mesh_serves_all_rollers(tree, robot):
    used = {mesh.get("filename") for mesh in tree.iter("mesh")}
    assert used == set(build_meshes(robot)) == {"meshes/roller.stl"}


def write(robot, folder):
    (folder / "meshes").mkdir()
    for name, data in build_meshes(robot).items():
        (folder / name).write_bytes(data)
    file = folder / "robot.urdf"
    file.write_text(build_urdf(robot))
    return file


def test_an_independent_reader_finds_the_bodies_of_the_world(robot, tmp_path):
    file = write(robot, tmp_path)
    read = dart.utils.DartLoader().parseSkeleton(str(file))
    rig = Rig(robot)
    ours = rig.body.skeleton
    angles = dict(zip(rig.joint_names, np.linspace(-3.0, 3.0, len(rig.joint_names)), strict=True))
    for skeleton in (read, ours):
        for name, angle in angles.items():
            skeleton.getJoint(name).setPosition(0, angle)
    for index in range(ours.getNumBodyNodes()):
        body = ours.getBodyNode(index)
        if body.getName() == "front_axle":  # weighs nothing, and hardly swings
            continue
        other = read.getBodyNode(body.getName())
        found, expected = (each.getWorldTransform().matrix() for each in (other, body))
        np.testing.assert_allclose(found, expected, atol=1e-9)  # the URDF has twelve digits
    # DART gives a link without inertia, which is only a frame, 1 kg.
    nothing = dart.dynamics.Inertia(1e-12, np.zeros(3), 1e-12 * np.eye(3))
    read.getBodyNode("camera_depth_optical_frame").setInertia(nothing)
    # The world's base carries camera and lidar, so the whole robot is compared.
    assert read.getMass() == pytest.approx(ours.getMass(), rel=1e-9)
    np.testing.assert_allclose(read.getCOM(), ours.getCOM(), atol=1e-9)
    found, expected = (each.getMassMatrix()[:6, :6] for each in (read, ours))
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_the_optical_frame_is_turned_as_the_camera_looks(nexus, tmp_path):
    camera = msgspec.structs.replace(nexus.camera, pitch_deg=20.0, yaw_deg=90.0)
    robot = msgspec.structs.replace(nexus, camera=camera)
    file = write(robot, tmp_path)
    read = dart.utils.DartLoader().parseSkeleton(str(file))
    frame = read.getBodyNode("camera_depth_optical_frame").getWorldTransform().matrix()
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    # by REP-103: x to its right, which is ahead of the robot; y down; z to the left and up
    right, down, ahead = (1.0, 0.0, 0.0), (0.0, s, -c), (0.0, c, s)
    expected = np.column_stack([right, down, ahead])
    np.testing.assert_allclose(frame[:3, :3], expected, atol=1e-9)  # twelve digits
    np.testing.assert_allclose(frame[:3, 3], camera.position_m, atol=1e-9)
