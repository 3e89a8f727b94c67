"""What is published in a tick, and its stamp."""

from __future__ import annotations

from typing import Any

from mecazen.keys import Topic, topic_of
from mecazen.messages import (
    Clock,
    FollowerState,
    Header,
    JointState,
    Observation,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Twist,
    Vector3,
)
from mecazen.wire import Stamp

TICK_NS = 10_000_000


def odometry(number: float) -> Odometry:
    pose = Pose(position=Point(number, -0.0, 0.1))
    return Odometry(pose=PoseWithCovariance(pose=pose, covariance=(1 / 3,) * 36))


def tick(number: int) -> dict[str, Any]:
    """What is published in a tick, by key."""
    return {
        "clock": Clock(),
        "joint_states": JointState(name=("a", "b"), position=(number / 3, 5e-324)),
        "odom": odometry(number / 7),
        "target/observation": Observation(poses=(odometry(number).pose,) * (number % 2)),
        "follower/state": FollowerState(header=Header(frame_id="odom"), tracking="waiting"),
        "cmd_vel": Twist(linear=Vector3(x=number / 10)),
    }


def stamp_of(number: int, run: int = 7, seed: int = 3) -> Stamp:
    return Stamp(number * TICK_NS, run, seed)


def topic_named(key: str) -> Topic[Any]:
    topic = topic_of(key)
    assert topic is not None
    return topic
