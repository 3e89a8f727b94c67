"""The robot that is drawn of a URDF."""

import math
from typing import Any

import numpy as np
import pytest
from mecazen import urdf
from mecazen.errors import RefusedError
from mecazen.messages import JointState
from mecazen_viewer.robot import RobotModel
from viewer.toy import URDF

BASE, WHEEL, ROLLERS, MAST = (
    f"world/robot/{name}" for name in ("base_link", "wheel", "roller_0", "mast")
)
PLACES, TURNS = (f"InstancePoses3D:{name}" for name in ("translations", "quaternions"))


def values(entities: dict[str, Any], path: str, component: str) -> np.ndarray:
    """Return the logged values of a component of a path."""
    batches = entities[path].as_component_batches()
    logged = {str(batch.component_descriptor()): batch for batch in batches}
    return np.array(logged[component].as_arrow_array().to_pylist())


def states(**angles: float) -> JointState:
    return JointState(name=tuple(angles), position=tuple(angles.values()))


def test_links_are_placed_by_all_joints():
    model = RobotModel(urdf.read(URDF), {"meshes/r.stl": b""})
    posed = dict(model.pose(states(wheel_joint=math.pi / 2, r0=math.pi / 2, other=9.0)))
    assert set(posed) == {path for path, _ in model.shapes} == {BASE, WHEEL, ROLLERS, MAST}
    # single precision
    near = {"abs": 1e-6}
    assert values(posed, BASE, PLACES)[0] == pytest.approx([0, 0, 0.1])
    assert values(posed, MAST, PLACES)[0] == pytest.approx([0.3, 0, 1])
    assert values(posed, WHEEL, PLACES) == pytest.approx(np.array([[0.1, 0.2, 0.05]]), **near)
    # the cylinder lies in its link by 1.5 rad about x, and the link is turned about y
    h = math.sqrt(0.5)
    a, b = h * math.sin(0.75), h * math.cos(0.75)
    assert values(posed, WHEEL, TURNS) == pytest.approx(np.array([[a, b, -a, b]]), **near)
    # a wheel that has turned a quarter about y has what was below it behind, and above it before
    places = np.array([[0.06, 0.2, 0.05], [0.14, 0.2, 0.05]])
    assert values(posed, ROLLERS, PLACES) == pytest.approx(places, **near)
    # a quarter about y after a quarter about z: of the joint's angle, and of the second's origin
    turned = np.array([[0.5, 0.5, 0.5, 0.5]] * 2)
    assert values(posed, ROLLERS, TURNS) == pytest.approx(turned, **near)


def test_a_wrong_description_is_refused():
    with pytest.raises(RefusedError, match=r"r\.stl"):
        RobotModel(urdf.read(URDF), {})
    cycle = "<joint><parent link='a'/><child link='a'/></joint>"
    with pytest.raises(RefusedError, match="cycle"):
        RobotModel(urdf.read(f"<robot>{cycle}</robot>"), {})
