"""The robot that is drawn of a URDF."""

import math

import numpy as np
import pytest
from mecazen import urdf
from mecazen.errors import RefusedError
from mecazen.messages import JointState
from mecazen_viewer.robot import RobotModel, read_stl
from viewer.toy import SQUARE, URDF
from viewer_stage import values

BASE, WHEEL, ROLLERS, MAST = (
    f"world/robot/{name}" for name in ("base_link", "wheel", "roller", "mast")
)


FILES = {"r.stl": SQUARE, "other.stl": SQUARE}


def toy() -> RobotModel:
    return RobotModel(urdf.read(URDF), FILES)


def states(**angles: float) -> JointState:
    return JointState(name=tuple(angles), position=tuple(angles.values()))


def test_groups_of_similar_names_have_separate_paths():
    links = {"front_left": "r", "front_right": "other", "rear_left": "other", "rear_right": "r"}
    text = "".join(
        f'<link name="{link}_roller"><visual><geometry><mesh filename="{mesh}.stl"/></geometry>'
        f'</visual></link><joint name="{link}" type="continuous"><parent link="base"/>'
        f'<child link="{link}_roller"/><axis xyz="0 1 0"/></joint>'
        for link, mesh in links.items()
    )
    shapes = RobotModel(urdf.read(f"<robot>{text}</robot>"), FILES).shapes
    assert [path for path, _ in shapes] == [ROLLERS, f"{ROLLERS}_2"]


def test_fixed_links_are_placed_by_fixed_joints():
    placed = [(path, components) for path, components in toy().shapes if path in (BASE, MAST)]
    (base, mast) = dict(placed).values()  # the later of shape and place
    assert values({BASE: base}, BASE, "Boxes3D:centers")[0] == pytest.approx([0, 0, 0.1])
    assert values({MAST: mast}, MAST, "Cylinders3D:centers")[0] == pytest.approx([0.3, 0, 1])


def test_moving_links_are_placed_by_all_joints():
    posed = dict(toy().pose(states(wheel_joint=math.pi / 2, r0=math.pi / 2, r1=0.0, other=9.0)))
    assert set(posed) == {WHEEL, ROLLERS}
    # single precision
    near = {"abs": 1e-6}
    assert values(posed, WHEEL, "Cylinders3D:centers") == pytest.approx(
        np.array([[0.1, 0.2, 0.05]]), **near
    )
    # the cylinder lies in its link by 1.5 rad about x, and the link is turned about y
    h = math.sqrt(0.5)
    a, b = h * math.sin(0.75), h * math.cos(0.75)
    hub = values(posed, WHEEL, "Cylinders3D:quaternions")
    assert hub == pytest.approx(np.array([[a, b, -a, b]]), **near)
    # a wheel that has turned a quarter about y has what was below it behind, and above it before
    places = values(posed, ROLLERS, "InstancePoses3D:translations")
    assert places == pytest.approx(np.array([[0.06, 0.2, 0.05], [0.14, 0.2, 0.05]]), **near)
    # a quarter about y after a quarter about z: of the joint's angle, and of the second's origin
    turned = values(posed, ROLLERS, "InstancePoses3D:quaternions")
    assert turned == pytest.approx(np.array([[0.5, 0.5, 0.5, 0.5]] * 2), **near)


NO_TREE = [
    "",
    "<joint><parent link='a'/><child link='a'/></joint>",
    "<joint><parent link='a'/><child link='b'/></joint>" * 2,
]


@pytest.mark.parametrize(
    ("build", "words"),
    [
        *((lambda j=joints: RobotModel(urdf.read(f"<robot>{j}</robot>"), {}), "no tree")
          for joints in NO_TREE),
        (lambda: RobotModel(urdf.read(URDF), {}), r"r\.stl"),
        (lambda: read_stl(b"solid"), "STL"),
        (lambda: read_stl(SQUARE[:-1]), "STL"),
    ],
)  # fmt: skip
def test_a_wrong_description_is_refused(build, words):
    with pytest.raises(RefusedError, match=words):
        build()
