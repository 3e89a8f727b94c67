"""What is read of a URDF, and the robot that is drawn of it."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from mecazen.messages import JointState
from mecazen_viewer import rotation, urdf
from mecazen_viewer.robot import RobotModel
from mecazen_viewer.stl import read_stl

URDF = """<robot name="toy">
  <material name="dark"><color rgba="0.1 0.2 0.3 1"/></material>
  <link name="base_link"><visual><origin xyz="0 0 0.1" rpy="0 0 0"/>
    <geometry><box size="0.4 0.2 0.1"/></geometry><material name="dark"/></visual></link>
  <link name="wheel"><visual><origin xyz="0 0 0" rpy="1.5 0 0"/>
    <geometry><cylinder radius="0.05" length="0.04"/></geometry></visual></link>
  <link name="roller_0"><visual><geometry><mesh filename="r.stl"/></geometry></visual></link>
  <link name="roller_1"><visual><geometry><mesh filename="r.stl"/></geometry></visual></link>
  <link name="mast"/>
  <joint name="wheel_joint" type="continuous"><parent link="base_link"/><child link="wheel"/>
    <origin xyz="0.1 0.2 0.05" rpy="0 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="r0" type="continuous"><parent link="wheel"/><child link="roller_0"/>
    <origin xyz="0 0 -0.04" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="r1" type="continuous"><parent link="wheel"/><child link="roller_1"/>
    <origin xyz="0 0 0.04" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/></joint>
  <joint name="mast_joint" type="fixed"><parent link="base_link"/><child link="mast"/>
    <origin xyz="0 0 1" rpy="0 0 0"/></joint>
</robot>"""

WHEEL = "world/robot/wheel"
ROLLERS = "world/robot/wheel/instances_0"


def stl(*triangles: tuple[tuple[float, float, float], ...]) -> bytes:
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(x for corner in facet for x in corner), 0)
        for facet in triangles
    )
    return bytes(80) + struct.pack("<I", len(triangles)) + facets


SQUARE = stl(((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0)))


def toy() -> RobotModel:
    return RobotModel(urdf.read(URDF), {"r.stl": SQUARE})


def states(**angles: float) -> JointState:
    return JointState(name=tuple(angles), position=tuple(angles.values()))


def quaternions(archetype: object, field: str) -> np.ndarray:
    return np.array(getattr(archetype, field).as_arrow_array().to_pylist())


def test_shapes_are_below_the_links_that_have_them_and_fixed_joints_place_theirs() -> None:
    paths = [path for path, _ in toy().shapes]
    assert paths == [
        "world/robot/shape",
        "world/robot/wheel/shape",
        ROLLERS,
        "world/robot/mast",
    ]


def test_leaves_with_one_mesh_on_one_parent_are_instances_each_turned_by_its_own_joint() -> None:
    posed = dict(toy().pose(states(wheel_joint=0.5, r0=math.pi / 2, r1=math.pi / 2, other=9.0)))
    assert set(posed) == {WHEEL, ROLLERS}
    h = math.sqrt(0.5)
    turned = quaternions(posed[ROLLERS], "quaternions")
    # single precision
    assert turned == pytest.approx(np.array([[0, 0, h, h], [0, 0, 1, 0]]), abs=1e-6)
    assert quaternions(posed[ROLLERS], "translations")[:, 2] == pytest.approx([-0.04, 0.04])
    wheel = quaternions(posed[WHEEL], "quaternion")[0]
    assert wheel == pytest.approx([0, math.sin(0.25), 0, math.cos(0.25)], abs=1e-6)
    assert quaternions(posed[WHEEL], "translation")[0] == pytest.approx([0.1, 0.2, 0.05])


def test_a_million_turns_leave_no_less_precision_than_none() -> None:
    one = dict(toy().pose(states(wheel_joint=0.0, r0=1.0, r1=0.0)))
    many = dict(toy().pose(states(wheel_joint=0.0, r0=1.0 + 1e6 * math.tau, r1=0.0)))
    a, b = (quaternions(posed[ROLLERS], "quaternions") for posed in (one, many))
    # a double at 6e6 rad has steps of 1e-9
    assert np.abs(a - b).max() < 1e-6


def test_states_without_a_joint_of_this_robot_turn_nothing() -> None:
    model = toy()
    assert list(model.pose(states(wheel_joint=0.0))) == []
    assert list(model.pose(JointState(name=("wheel_joint", "r0", "r1"), position=(0.0,)))) == []
    assert len(list(model.pose(states(r1=0.0, r0=0.0, wheel_joint=0.0)))) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no element"),
        ("<robot><link name='a'><visual/></link></robot>", "visual  without geometry"),
        ("<robot><link name='a'><visual><geometry/></visual></link></robot>", "empty geometry"),
        (URDF.replace("box size", "ball size").replace("</box>", "</ball>"), "ball"),
        (URDF.replace('xyz="0 1 0"', 'xyz="0 1"'), "not enough values"),
        (URDF.replace('<child link="mast"/>', ""), "mast_joint without child"),
    ],
)
def test_what_is_no_urdf_is_refused_with_what_is_wrong(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        urdf.read(text)
    assert "not a URDF" in str(caught.value)


def test_links_that_are_no_tree_are_refused() -> None:
    with pytest.raises(ValueError, match="no tree"):
        RobotModel(urdf.read("<robot/>"), {})


def test_a_mesh_without_a_file_is_refused() -> None:
    with pytest.raises(ValueError, match=r"r\.stl"):
        RobotModel(urdf.read(URDF), {})


def test_corners_in_one_place_become_one_vertex_with_the_mean_normal() -> None:
    vertices, triangles, normals = read_stl(SQUARE)
    assert len(vertices) == 4
    assert np.asarray(vertices)[triangles].tolist() == [
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 1, 0], [0, 1, 0]],
    ]
    assert normals.tolist() == [[0, 0, 1]] * 4


@pytest.mark.parametrize("data", [b"", b"solid", SQUARE[:-1], bytes(90)])
def test_what_is_no_binary_stl_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="STL"):
        read_stl(data)


def test_roll_pitch_yaw_are_about_the_fixed_axes_in_that_order() -> None:
    roll, pitch, yaw = 0.3, -0.4, 1.2
    axes = np.eye(3)
    one = rotation.multiply(
        rotation.about(axes[2], yaw),
        rotation.multiply(rotation.about(axes[1], pitch), rotation.about(axes[0], roll)),
    )
    assert rotation.from_rpy((roll, pitch, yaw)) == pytest.approx(one)
    # x turned by yaw alone, then the whole, by the textbook's matrix element r11 = cos y cos p
    x, y, z, w = one
    assert 1 - 2 * (y * y + z * z) == pytest.approx(math.cos(yaw) * math.cos(pitch))
    assert 2 * (w * y - x * z) == pytest.approx(math.sin(pitch))
