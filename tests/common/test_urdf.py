"""The robot's description: built, served and read; other XML is refused with the reason."""

from itertools import pairwise
from xml.etree import ElementTree as ET

import pytest
from harness import load_robot
from mecazen import keys, urdf
from mecazen.errors import BusError, ConfigError, RefusedError
from mecazen.messages import Empty
from mecazen.robot import WHEEL_JOINTS
from mecazen.urdf import RobotDescription, ask_description, build_urdf, serve_description
from msgspec.structs import replace
from viewer.toy import URDF, stl

TENFOLD = [f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise("abcdefghi")]
BOMB = f'<!DOCTYPE r [<!ENTITY a "{"x" * 1000}">{"".join(TENFOLD)}]><robot name="&i;"/>'
"""XML of 2 kB whose name would have 100 GB."""
JOINT = "<joint><parent link='a'/><child link='b'/></joint>"


def test_the_description_has_every_roller_and_mesh():
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


def test_a_robot_has_the_sensors_of_its_file():
    robot = load_robot()
    lidar = replace(robot.lidar, frame="laser")
    links = {joint.child for joint in urdf.read(build_urdf(replace(robot, lidar=lidar))).joints}
    assert {"laser", "camera_link", "camera_depth_optical_frame"} <= links
    read = urdf.read(build_urdf(replace(robot, lidar=None, camera=None)))
    assert not [joint for joint in read.joints if joint.axis is None]
    with pytest.raises(ValueError, match="each frame must have its own name"):
        replace(robot, lidar=replace(robot.lidar, frame="base_link"))


def test_each_robots_description_is_served(bus):
    served = {
        robot: RobotDescription(f"<robot {robot}>", {"meshes/wheel.stl": robot.encode()})
        for robot in ("one", "two")
    }
    for robot, description in served.items():
        serve_description(bus, robot, description)
    assert {robot: ask_description(bus, robot, 1.0) for robot in served} == served
    with pytest.raises(BusError, match=r"^robot_description: nobody answers"):
        ask_description(bus, "", 1.0)
    call = keys.call_of_robot(keys.ROBOT_DESCRIPTION, "two")
    assert bus.call(call, Empty()).data == "<robot two>"


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
