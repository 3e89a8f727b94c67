"""A world of a few lines."""

from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import GROUND_TRUTH, JOINT_COMMAND, JOINT_STATES
from mecazen.messages import JointState, planar_odometry
from mecazen.node import Node


class Carts(Node):
    """Moves a robot along x at the speed of its newest command."""

    def reset(self, seed):
        self.x = self.speed = 0.0

    def step(self, tick, inputs):
        command = inputs.get(JOINT_COMMAND)
        if command is not None:
            self.speed = command.velocity[0]
        self.age_s = inputs.age_s(JOINT_COMMAND)
        self.x += self.speed * tick.period_s * bool(tick.number)
        pose = Pose2D(x=self.x)
        truth = planar_odometry(tick.time, "world", "base_link", pose, Twist2D())
        return {JOINT_STATES: JointState(header=truth.header), GROUND_TRUTH: truth}

    def diagnostics(self):
        return {"age_s": self.age_s}
