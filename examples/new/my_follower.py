"""A follower: look at the person and keep 1 m from them."""

import math

from mecazen.geometry import Twist2D
from mecazen.keys import CMD_VEL, OBSERVATION, ODOM
from mecazen.messages import Twist
from mecazen.node import Inputs, Node, Outputs, Row, Tick, due, every


class MyFollower(Node):
    """Drives by the last observation alone."""

    ROW = Row("follower", inputs=(every(ODOM), due(OBSERVATION)), outputs=(CMD_VEL,))

    def reset(self, seed: int) -> None:
        """Begin a run: as if the person were in place."""
        self.x, self.y = 1.0, 0.0

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the velocity wanted in this tick: forward, left, turn."""
        if (frame := inputs.get(OBSERVATION)) and frame.poses:
            self.x, self.y, _ = frame.poses[0].pose.to_planar()  # seen from the robot
        ahead = 1.5 * (math.hypot(self.x, self.y) - 1.0)
        return {CMD_VEL: Twist.planar(Twist2D(x=ahead, yaw=1.5 * math.atan2(self.y, self.x)))}
