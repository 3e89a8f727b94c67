"""Samples of a tick, and their stamp."""

from typing import Any

from mecazen import messages as m
from mecazen.wire import Stamp

TICK_NS = 10_000_000


def odometry(number: float) -> m.Odometry:
    pose = m.Pose(position=m.Point(number, -0.0, 0.1))
    return m.Odometry(pose=m.PoseWithCovariance(pose=pose, covariance=(1 / 3,) * 36))


def tick(number: int) -> dict[str, Any]:
    """Return the samples of a tick, by key."""
    return {
        "clock": m.Clock(),
        "joint_states": m.JointState(name=("a", "b"), position=(number / 3, 5e-324)),
        "odom": odometry(number / 7),
        "target/observation": m.Observation(poses=(odometry(number).pose,) * (number % 2)),
        "follower/state": m.FollowerState(header=m.Header(frame_id="odom"), tracking="waiting"),
        "cmd_vel": m.Twist(linear=m.Vector3(x=number / 10)),
    }


def stamp_of(number: int, run: int = 7, seed: int = 3) -> Stamp:
    return Stamp(number * TICK_NS, run, seed)
