"""The robot's frames and shapes, against turns and bodies that are known by hand."""

import math
import struct
from xml.etree import ElementTree as ET

import pytest
from mecazen.messages import Header, JointState, Time
from mecazen_ros.description import SLICES, MovingFrames, fixed_frames, portable

HALF = math.sqrt(0.5)
URDF = """<robot name="r">
  <link name="base_link"/>
  <link name="wheel">
    <visual>
      <origin xyz="0 0 1" rpy="1.5707963267948966 0 0"/>
      <geometry><mesh filename="m.stl"/></geometry>
      <material name="black"/>
    </visual>
    <visual><geometry><mesh filename="package://other/m.stl"/></geometry></visual>
  </link>
  <link name="camera"/>
  <joint name="turning" type="continuous">
    <parent link="base_link"/><child link="wheel"/>
    <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><axis xyz="0 2 0"/>
  </joint>
  <joint name="fixed" type="fixed">
    <parent link="base_link"/><child link="camera"/>
    <origin xyz="0.1 0 0.2" rpy="-1.5707963267948966 0 -1.5707963267948966"/>
  </joint>
  <joint name="sliding" type="prismatic"><parent link="base_link"/><child link="camera"/></joint>
</robot>"""


def of(transform):
    t, r = transform.transform.translation, transform.transform.rotation
    return (t.x, t.y, t.z), (r.x, r.y, r.z, r.w)


def test_a_fixed_frame_is_turned_as_its_joint_says():
    (frame,) = fixed_frames(URDF, "").transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("base_link", "camera")
    # an optical frame: the quaternion that REP-103's users write by hand
    assert of(frame) == (
        pytest.approx((0.1, 0.0, 0.2)),
        pytest.approx((-0.5, 0.5, -0.5, 0.5)),
    )


def test_the_frame_of_a_wheel_turns_about_its_axis_after_its_joints_own_turn():
    state = JointState(Header(Time(1)), ("turning", "of_another"), (math.pi / 2, 1.0))
    (frame,) = MovingFrames(URDF, "robot1/")(state).transforms
    assert frame.header.stamp == Time(1)
    assert (frame.header.frame_id, frame.child_frame_id) == ("robot1/base_link", "robot1/wheel")
    # 90 degrees about z, then as much about the turned y: (0 0 s c) x (0 s 0 c)
    assert of(frame) == ((1.0, 2.0, 3.0), pytest.approx((-0.5, 0.5, 0.5, 0.5)))


def test_moving_frames_come_25_times_a_second_and_at_once_in_a_new_run():
    frames = MovingFrames(URDF, "")
    stamps = [*range(0, 1_000_000_000, 10_000_000), 0]
    given = [
        frames(JointState(Header(Time.from_ns(ns)), ("turning",), (0.0,))) is not None
        for ns in stamps
    ]
    assert sum(given[:-1]) == 25
    assert given[-1]


def stl(*facets):
    packed = b"".join(struct.pack("<12fH", 0, 0, 0, *a, *b, *c, 0) for a, b, c in facets)
    return bytes(80) + struct.pack("<I", len(facets)) + packed


def test_cylinders_stand_for_a_mesh_that_ros_cant_fetch_and_for_no_other():
    end, middle, other = (0.0, 0.3, -0.5), (0.4, 0.0, 0.0), (0.0, -0.2, 0.5)
    barrel = stl((end, end, end), (middle, middle, middle), (middle, other, middle))
    shown = ET.fromstring(portable(URDF, {"m.stl": barrel}))  # noqa: S314 - made here
    wheel = shown.find("link[@name='wheel']")
    assert [mesh.get("filename") for mesh in wheel.iter("mesh")] == ["package://other/m.stl"]
    parts = [part for part in wheel.iter("visual") if part.find("geometry/cylinder") is not None]
    assert len(parts) == SLICES == 5
    radii = [float(part.find("geometry/cylinder").get("radius")) for part in parts]
    assert radii == pytest.approx([0.3, 0.0, 0.4, 0.4, 0.4], abs=1e-6)
    assert {part.find("geometry/cylinder").get("length") for part in parts} == {"0.2"}
    # z of the mesh is -y of the link by the quarter turn about x
    first = [float(value) for value in parts[0].find("origin").get("xyz").split()]
    assert first == pytest.approx([0.0, 0.4, 1.0])
    assert parts[0].find("material").get("name") == "black"
