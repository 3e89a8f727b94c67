"""The same robot in MuJoCo."""

from itertools import product

import pytest
from mecazen_bench import gazebo_peer
from mecazen_bench.engine import measure_accuracy
from mecazen_bench.stack import robot

STEP_S = 0.001


def test_the_same_robot_drives_alike_in_mujoco():
    pytest.importorskip("mujoco", reason="MuJoCo, the bench's peer, is not installed")
    from mecazen_bench.mujoco_peer import OPTIONS, MujocoEngine

    for shape, settings in product(gazebo_peer.SHAPES, OPTIONS):
        found = measure_accuracy(MujocoEngine(robot("nexus"), STEP_S, shape, settings))
        # its contacts are soft and its capsules are not barrels: some percent off
        assert found.forward == pytest.approx(1.0, abs=0.1)
        assert found.lateral == pytest.approx(1.0, abs=0.1)
        assert found.yaw == pytest.approx(1.0, abs=0.1)
        assert 0.0 < found.ripple < 0.003
        assert -1.0 < found.energy < 0.0
