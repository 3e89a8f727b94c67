"""A run that a test tells tick by tick."""

from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import FollowerState, Time, Twist, planar_odometry
from mecazen.wire import Stamp
from mecazen_tools.trajectory import Trajectory

TICK_NS = 10_000_000
ALL = ("physics", "controller", "target", "follower")


class Run:
    """A bus with the samples of a run, and its trajectory."""

    def __init__(self, ticks, services=ALL):
        self.bus = LocalBus()
        self.trajectory = Trajectory(self.bus, TICK_NS, ticks, services)

    def put(self, topic, tick, message):
        self.bus.publisher(topic).put(message, Stamp(tick * TICK_NS, 1, 0))

    def pose(self, topic, tick, *pose):
        odometry = planar_odometry(Time(), "world", "base", Pose2D(*pose), Twist2D(0.5, 0.25, 1.0))
        self.put(topic, tick, odometry)

    def tick(self, tick, robot=(0.0, 0.0, 0.0), person=(1.0, 0.0, 0.0)):
        self.pose(keys.GROUND_TRUTH, tick, *robot)
        self.pose(keys.ODOM, tick, 0.5, 0.25, 0.0)
        self.pose(keys.TARGET_ODOM, tick, *person)
        self.put(keys.FOLLOWER_STATE, tick, FollowerState(tracking="waiting"))
        self.put(keys.CMD_VEL, tick, Twist.planar(Twist2D(0.125, -0.5, 2.0)))
