"""What the tests of paths share."""

import pytest
from mecazen.geometry import Twist2D
from mecazen_target.gait import with_gait


@pytest.fixture
def differences():
    """From a path, a gait, a time and dt: the motion, and its twist and speed by differences."""

    def central(path, gait, t, dt):
        before, now, after = (
            motion if gait is None else with_gait(motion, gait)
            for motion in (path.at(t - dt), path.at(t), path.at(t + dt))
        )
        step = before.pose.between(after.pose)
        x, y = now.pose.between(after.pose)[:2]
        dx, dy = now.pose.between(before.pose)[:2]
        twist = Twist2D((x - dx) / (2 * dt), (y - dy) / (2 * dt), step.yaw / (2 * dt))
        return now, twist, (after.distance - before.distance) / (2 * dt)

    return central
