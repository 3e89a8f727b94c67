"""What a tracker knows of bodies: factors by joint, and legs that can be confused."""

from mecazen.skeleton import INDEX, JOINTS
from mecazen_sensors.body import MIRRORED, scales


def test_a_factor_is_that_of_both_sides_and_else_1():
    factors = scales({"knee": 2.0, "pelvis": 3.0})
    doubled = {name for name in JOINTS if factors[INDEX[name]] == 2.0}
    assert doubled == {"left_knee", "right_knee"}
    assert factors[INDEX["pelvis"]] == 3.0
    assert sorted(factors)[:-3] == [1.0] * (len(JOINTS) - 3)


def test_each_joint_has_the_same_one_of_the_other_side():
    assert MIRRORED[INDEX["left_knee"]] == INDEX["right_knee"]
    assert MIRRORED[INDEX["pelvis"]] == INDEX["pelvis"]
    assert [MIRRORED[i] for i in MIRRORED] == list(range(len(JOINTS)))
