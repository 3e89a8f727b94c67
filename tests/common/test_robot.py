"""The robot's file and its description in URDF. Wrong files: test_wrong_inputs."""

import math
from itertools import pairwise
from xml.etree import ElementTree as ET

import pytest
from harness import load_robot
from mecazen import urdf
from mecazen.errors import ConfigError, RefusedError
from mecazen.robot import WHEEL_JOINTS, CameraMount, Payload, roller_joint
from mecazen.urdf import build_urdf
from msgspec.structs import replace
from viewer.toy import URDF, stl


@pytest.fixture
def robot():
    """A robot of round numbers: axles 0.4 m apart, wheels 0.3 m, 0.1 m in diameter."""
    robot = load_robot()
    wheels = replace(robot.wheels, wheelbase_m=0.4, track_m=0.3, radius_m=0.05, hub_width_m=0.04)
    base = replace(robot.base, length_m=0.3, width_m=0.2, height_m=0.1, clearance_m=0.04)
    rollers = replace(robot.rollers, count=4, max_radius_m=0.02)
    camera = CameraMount(size_m=(0.1, 0.1, 0.06), position_m=(0.0, 0.0, 0.2), mass_kg=0.1)
    lidar = replace(robot.lidar, position_m=(0.0, 0.0, 0.15), size_m=(0.03, 0.04))
    parts = {"wheels": wheels, "base": base, "rollers": rollers, "camera": camera}
    return replace(robot, **parts, lidar=lidar, payload=None)


def test_footprint_and_height_hold_all_parts(robot):
    # along: 0.2 m to the axle and a radius; across: 0.15 m to the wheel's middle and a radius,
    # since its rollers reach only (0.05 - 0.02) tan(45°) / tan(45°) + 0.02 = 0.05 m
    assert robot.footprint == pytest.approx((0.25, 0.2))
    assert robot.height == pytest.approx(0.23)
    # steeper rollers reach further: 0.03 / tan(30°) + 0.02
    steep = replace(robot, rollers=replace(robot.rollers, angle_deg=30.0))
    assert steep.footprint[1] == pytest.approx(0.15 + 0.03 * math.sqrt(3.0) + 0.02)
    load = Payload(mass_kg=1.0, position_m=(-0.3, 0.0, 0.3), size_m=(0.2, 0.5, 0.2))
    assert replace(robot, payload=load).footprint == pytest.approx((0.4, 0.25))
    assert replace(robot, payload=load).height == pytest.approx(0.4)


def test_a_robot_stands_about_its_wheels_and_turns_about_base_link(robot):
    behind = replace(robot, wheels=replace(robot.wheels, centre_m=(0.1, -0.05)))
    assert behind.wheel_position("front_right") == pytest.approx((0.3, -0.2, 0.05))
    # the rectangle is about base_link, with the nearer side as far out as the other
    assert behind.footprint == pytest.approx((0.35, 0.25))
    assert behind.swing == pytest.approx(0.15)
    with pytest.raises(ValueError, match=r"base_link is not between the wheels"):
        replace(robot.wheels, centre_m=(0.21, 0.0))


def test_rollers_too_thin_for_a_circle_are_refused(robot):
    # Rollers meet π/N from their middles. There the wheel's circle is R cos(π/N) below the axle,
    # and a roller's axis, straight and level, R - r: 0.0475 (1 - cos 30°) = 6.364 mm
    wheels = replace(robot.wheels, radius_m=0.0475)
    thick, thin = (
        replace(robot.rollers, count=6, max_radius_m=radius) for radius in (0.0064, 0.0063)
    )
    assert replace(robot, wheels=wheels, rollers=thick).rollers.count == 6
    with pytest.raises(ValueError, match=r"max_radius_m = 0.0063 must be above 0.006364: "):
        replace(robot, wheels=wheels, rollers=thin)


def test_wheels_are_at_the_corners_and_turn_the_robot_by_their_lever(robot):
    assert (robot.cross_gain, robot.lever) == (1.0, pytest.approx(0.15 + 0.2))
    steep = replace(robot, rollers=replace(robot.rollers, angle_deg=30.0, arrangement="O"))
    assert steep.cross_gain == pytest.approx(-math.sqrt(3.0))
    assert robot.wheel_position("front_left") == pytest.approx((0.2, 0.15, 0.05))
    assert robot.wheel_position("rear_right") == pytest.approx((-0.2, -0.15, 0.05))
    assert robot.wheels.joints[3] == "rear_right_wheel_joint"
    assert roller_joint("rear_right", 3) == "rear_right_roller_03_joint"


TENFOLD = [f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise("abcdefghi")]
BOMB = f'<!DOCTYPE r [<!ENTITY a "{"x" * 1000}">{"".join(TENFOLD)}]><robot name="&i;"/>'
"""XML of 2 kB whose name would have 100 GB."""
JOINT = "<joint><parent link='a'/><child link='b'/></joint>"


def test_the_description_has_every_roller_mesh_and_sensor():
    robot = load_robot()
    read = urdf.read(build_urdf(robot, "base_footprint"))
    turning = [joint.name for joint in read.joints if joint.axis is not None]
    assert turning[:4] == list(WHEEL_JOINTS)
    assert len(turning) == 4 + 4 * robot.rollers.count
    assert read.joints[-1].parent == "base_footprint"
    meshes = {visual.mesh for visual in read.visuals.values() if visual.mesh}
    assert meshes == urdf.build_meshes(robot).keys()
    with pytest.raises(ConfigError, match="lidar_link is another link of the robot"):
        build_urdf(robot, "lidar_link")
    lidar = replace(robot.lidar, frame="laser")
    links = {joint.child for joint in urdf.read(build_urdf(replace(robot, lidar=lidar))).joints}
    assert {"laser", "camera_link", "camera_depth_optical_frame"} <= links
    read = urdf.read(build_urdf(replace(robot, lidar=None, camera=None)))
    assert not [joint for joint in read.joints if joint.axis is None]
    with pytest.raises(ValueError, match="each frame must have its own name"):
        replace(robot, lidar=replace(robot.lidar, frame="base_link"))


def test_cylinders_take_the_place_of_meshes():
    text = """<robot name="r"><link name="wheel">
      <visual><origin xyz="0 0 1" rpy="1.5707963267948966 0 0"/>
        <geometry><mesh filename="m.stl"/></geometry><material name="black"/></visual>
      <visual><geometry><mesh filename="package://other/m.stl"/></geometry></visual>
    </link></robot>"""
    # facets at the lower end, in the middle, and from there to the upper end
    lower, middle, upper = (0.0, 0.3, -0.5), (0.4, 0.0, 0.0), (0.0, -0.2, 0.5)
    mesh = stl((lower,) * 3, (middle,) * 3, (middle, upper, middle))
    robot = ET.fromstring(urdf.portable_urdf(text, {"m.stl": mesh}))  # noqa: S314
    assert [mesh.get("filename") for mesh in robot.iter("mesh")] == ["package://other/m.stl"]
    _, *parts = robot.findall("link/visual")
    radii = [float(part.find("geometry/cylinder").get("radius")) for part in parts]
    assert radii == pytest.approx([0.3, 0.0, 0.4, 0.4, 0.4], abs=1e-6)
    assert {part.find("geometry/cylinder").get("length") for part in parts} == {"0.2"}
    # z of the mesh is -y of the link by the quarter turn about x
    center = [float(value) for value in parts[0].find("origin").get("xyz").split()]
    assert center == pytest.approx([0.0, 0.4, 1.0])
    assert parts[0].find("material").get("name") == "black"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a URDF: no element"),
        (BOMB, "amplification"),
        ("<!DOCTYPE r [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><r>&x;</r>", "undefined entity"),
        ("<robot><link name='a'><visual><geometry/></visual></link></robot>", "empty geometry"),
        (URDF.replace("box size", "ball size").replace("</box>", "</ball>"), "ball"),
        (URDF.replace('xyz="0 1 0"', 'xyz="0 1"'), "'0 1' must be 3 numbers"),
        (URDF.replace('<child link="mast"/>', ""), "mast_joint without child"),
        (f"<robot>{JOINT * 1001}</robot>", "1001 joints; at most 1000"),
    ],
)
def test_text_that_is_no_urdf_is_refused(text, words):
    with pytest.raises(RefusedError, match=words):
        urdf.read(text)
