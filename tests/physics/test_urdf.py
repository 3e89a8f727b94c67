from __future__ import annotations

from xml.etree import ElementTree as ET

import dartpy as dart
import numpy as np
import pytest
from mecazen.robot import Robot
from mecazen_physics.urdf import build_urdf, meshes
from physics_rig import Rig


@pytest.fixture
def tree(robot: Robot) -> ET.Element:
    return ET.fromstring(build_urdf(robot))  # noqa: S314 - our own text


def test_moving_joints_are_those_of_the_world_in_its_order(tree, robot):
    moving = [joint.get("name") for joint in tree.iter("joint") if joint.get("type") != "fixed"]
    assert tuple(moving) == Rig(robot).joint_names
    fixed = [joint.get("name") for joint in tree.iter("joint") if joint.get("type") == "fixed"]
    assert fixed == ["camera_joint", "lidar_joint"]


def test_every_link_but_the_root_hangs_on_one_joint(tree):
    links = [link.get("name") for link in tree.findall("link")]
    children = [child.get("link") for child in tree.findall("joint/child")]
    assert sorted(children) == sorted(set(links) - {"base_link"})
    assert len(set(links)) == len(links)


def test_masses_sum_up_to_the_robot_files(tree, robot):
    total = sum(float(mass.get("value", "nan")) for mass in tree.iter("mass"))
    wheel = robot.wheels.hub_mass_kg + robot.rollers.count * robot.rollers.mass_kg
    expected = robot.base.mass_kg + 4 * wheel + robot.camera.mass_kg + robot.lidar.mass_kg
    assert total == pytest.approx(expected, rel=1e-12)


def test_one_mesh_serves_all_rollers(tree, robot):
    used = {mesh.get("filename") for mesh in tree.iter("mesh")}
    assert used == set(meshes(robot)) == {"meshes/roller.stl"}


def test_an_independent_reader_finds_the_bodies_of_the_world(robot, tmp_path):
    (tmp_path / "meshes").mkdir()
    for name, data in meshes(robot).items():
        (tmp_path / name).write_bytes(data)
    file = tmp_path / "robot.urdf"
    file.write_text(build_urdf(robot))
    read = dart.utils.DartLoader().parseSkeleton(str(file))
    rig = Rig(robot, rollers="all")
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
    # The world's base carries camera and lidar, so the whole robot is compared.
    assert read.getMass() == pytest.approx(ours.getMass(), rel=1e-9)
    np.testing.assert_allclose(read.getCOM(), ours.getCOM(), atol=1e-9)
    found, expected = (each.getMassMatrix()[:6, :6] for each in (read, ours))
    np.testing.assert_allclose(found, expected, atol=1e-8)
