"""A robot's motion in DART's coordinates, its state in ROS's, and states that make no sense."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen_physics.errors import DivergedError
from physics_rig import Rig, wheel_speeds


def test_velocity_is_in_the_axes_of_base_link(nexus):
    rig = Rig(nexus, Pose2D(yaw=2.0))
    before, after = rig.drive(wheel_speeds(nexus, Twist2D(0.3, 0.0, 0.4)), 1.0)[-2:]
    # Ripple of the contacts: some mm/s.
    assert after.linear == pytest.approx((0.3, 0.0, 0.0), abs=0.01)
    assert after.angular == pytest.approx((0.0, 0.0, 0.4), abs=0.08)
    # In the plane the same as DART's, and as the finite difference over 10 ms, in axes turned by
    # `heading`; height and tilts are projected, so their rates are zero.
    body, heading = rig.body.skeleton.getBodyNode(0), rig.body.world.heading
    _, _, yaw_rate, x, y, _ = body.getSpatialVelocity()
    np.testing.assert_allclose(
        (*after.angular, *after.linear), (0.0, 0.0, yaw_rate, x, y, 0.0), atol=1e-9
    )
    np.testing.assert_allclose(
        np.subtract(after.position, before.position)[:2] / 0.01,
        rotate(*body.getLinearVelocity()[:2], heading),
        atol=0.01,
    )


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda robot: robot.setVelocity(8, math.nan), "not finite"),
        (lambda robot: robot.setPosition(15, math.inf), "not finite"),
        (lambda robot: robot.setPosition(5, -0.2), "below the ground"),
        (lambda robot: robot.setPosition(4, math.nan), "moved"),
        (lambda robot: robot.setVelocity(3, 1e5), "moved|not finite"),
    ],
)
def test_a_diverged_state_is_an_error_with_the_last_good_one(nexus, spoil, reason):
    rig = Rig(nexus, Pose2D(1.0, 2.0, 0.0))
    rig.advance([0.0] * 4, 10)
    spoil(rig.body.skeleton)
    with pytest.raises(DivergedError, match=reason) as caught:
        rig.advance([0.0] * 4, 10)
    good = re.search(r"last good state at 0\.010 s: position \(([^,]*),", str(caught.value))
    assert good
    assert float(good[1]) == pytest.approx(1.0)
    assert rig.state().time == pytest.approx(0.01)
