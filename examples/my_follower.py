"""A follower of one's own: look at the person and keep 1 m from them."""

import math

from mecazen.follower import Follower
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import Observation, Odometry
from mecazen.wire import Stamp


class MyFollower(Follower):
    """Drives by the last observation alone."""

    def reset(self, seed: int) -> None:
        """Begin a run: nobody seen yet."""
        self.person: Pose2D | None = None

    def follow(self, odom: Odometry, frame: Observation | None, stamp: Stamp) -> Twist2D:
        """Return the velocity wanted in this tick: forward, left, turn."""
        if frame is not None and frame.poses:  # no frame in most ticks; empty if unseen
            self.person = frame.poses[0].pose.to_planar()  # seen from the robot
        if self.person is None:
            return Twist2D()
        distance = math.hypot(self.person.x, self.person.y)
        bearing = math.atan2(self.person.y, self.person.x)
        return Twist2D(x=1.5 * (distance - 1.0), yaw=1.5 * bearing)
