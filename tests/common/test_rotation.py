"""Rotations by quaternions, against textbooks."""

import math

import numpy as np
import pytest
from mecazen import rotation


def test_roll_pitch_yaw_are_about_the_fixed_axes_in_that_order():
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
