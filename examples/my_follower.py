"""A follower of one's own: look at the person and keep 1 m from them."""

import math

from mecazen.geometry import Pose2D, Twist2D
from mecazen.graph import Row, due, every
from mecazen.keys import CMD_VEL, OBSERVATION, ODOM
from mecazen.messages import Twist
from mecazen.node import Inputs, Node, Outputs, Tick


class MyFollower(Node):
    """Drives by the last observation alone."""

    ROW = Row("follower", inputs=(every(ODOM), due(OBSERVATION)), outputs=(CMD_VEL,))

    def reset(self, seed: int) -> None:
        """Begin a run: nobody seen yet."""
        self.person = Pose2D(x=1.0)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the velocity wanted in this tick: forward, left, turn."""
        frame = inputs.get(OBSERVATION)
        if frame and frame.poses:  # no frame in most ticks; empty if unseen
            self.person = frame.poses[0].pose.to_planar()  # seen from the robot
        distance = math.hypot(self.person.x, self.person.y)
        bearing = math.atan2(self.person.y, self.person.x)
        return {CMD_VEL: Twist.planar(Twist2D(x=1.5 * (distance - 1.0), yaw=1.5 * bearing))}
