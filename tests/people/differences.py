"""What the tests of paths share: twists and speeds by differences."""

from mecazen.geometry import Twist2D
from mecazen_people.motion import with_gait


def differences(path, gait, t, dt):
    """Return the motion at a time [s], and its twist and speed by differences over 2 dt [s]."""
    before, now, after = (
        motion if gait is None else with_gait(motion, gait)
        for motion in (path.at(t - dt), path.at(t), path.at(t + dt))
    )
    step = before.pose.between(after.pose)
    x, y = now.pose.between(after.pose)[:2]
    dx, dy = now.pose.between(before.pose)[:2]
    twist = Twist2D((x - dx) / (2 * dt), (y - dy) / (2 * dt), step.yaw / (2 * dt))
    return now, twist, (after.distance - before.distance) / (2 * dt)
