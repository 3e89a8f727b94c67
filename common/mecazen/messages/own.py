"""Messages of `mecazen_msgs`: what has no equal in ROS."""

from __future__ import annotations

from typing import Annotated

import msgspec

from mecazen.messages.ros import (
    Count,
    Float,
    Floats,
    Header,
    Message,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Time,
    Twist,
    UInt32,
)


class _OwnMessage(Message):
    """Base of all messages of `mecazen_msgs`; each has the name of its class there."""

    def __init_subclass__(cls) -> None:
        cls.ROS_TYPE = f"mecazen_msgs/msg/{cls.__name__}"


class Skeleton(_OwnMessage):
    """The body of a person: joints in header.frame_id, in the order of `mecazen.skeleton.JOINTS`.

    The truth leaves `std` and `confidence` empty; a tracker leaves empty what it does not measure.
    """

    header: Header = Header()
    id: str = ""
    height: Float = 0.0
    """Of the body [m]; 0 where it is not known."""
    joints: tuple[Point, ...] = ()
    std: Floats = ()
    """Standard deviation of each joint along any axis [m]."""
    confidence: tuple[UInt32, ...] = ()
    """Of each joint, as in k4abt: 0 none (out of view), 1 low (occluded), 2 medium (seen)."""
    angles: Floats = ()
    """Sagittal angles in the order of `mecazen.skeleton.ANGLES` [rad]."""
    phases: Floats = ()
    """Share of the gait cycle since the last foot strike, left and right."""


class Skeletons(_OwnMessage):
    """One frame of a body tracker: everybody seen, in any order; none if nobody was.

    header.stamp is when the frame was taken; the message comes later by the tracker's latency.
    """

    header: Header = Header()
    skeletons: tuple[Skeleton, ...] = ()


class Person(_OwnMessage):
    """Where somebody truly is, in the frame of a `People`."""

    id: str = ""
    pose: Pose = Pose()
    twist: Twist = Twist()
    """In the person's own frame: x forward, y left."""
    height: Float = 0.0
    """Of the body [m]; 0 where it is not known."""
    joints: tuple[Point, ...] = ()
    """In the order of `mecazen.skeleton.JOINTS`; empty where no sensor looks at them."""


class NamedPose(_OwnMessage):
    """Where the robot of a name truly is."""

    name: str = ""
    pose: Pose = Pose()


class People(_OwnMessage):
    """Everybody in the world: the persons that robots follow, all others, and the robots."""

    header: Header = Header()
    persons: tuple[Person, ...] = ()
    """First those whom robots follow, by the robots' names ("target" of a single one)."""
    robots: tuple[NamedPose, ...] = ()


class Observation(_OwnMessage):
    """One frame of the robot's person sensor: everybody seen, in any order; none if nobody was.

    header.stamp is when the frame was taken; the message comes later by the sensor's latency.
    """

    header: Header = Header()
    poses: tuple[PoseWithCovariance, ...] = ()
    ids: tuple[str, ...] = ()
    """The sensor's name for each of them; empty if it tells nobody apart."""


class FollowerState(_OwnMessage):
    """What the follower believes and wants; poses and velocities in header.frame_id."""

    header: Header = Header()
    tracking: str = ""
    """waiting, following, coasting or lost."""
    estimator: str = ""
    estimate: tuple[Odometry, ...] = ()
    """The person; empty until first seen."""
    goal: tuple[Pose, ...] = ()
    """Where the robot should be; empty until the person is first seen."""
    distance_error: Float = 0.0
    """Distance to the estimate less the standoff distance [m]."""
    bearing_error: Float = 0.0
    """Angle around the person, of the robot less of the goal [rad]."""
    heading_error: Float = 0.0
    """Heading of the robot less of the goal [rad]."""
    last_seen_s: Float = 0.0
    """Simulated time since the last frame that showed the person [s]."""
    plan: str = ""
    """open (nothing is near), avoiding, gave_up_distance, gave_up_visibility, gave_up_bearing,
    gave_up_heading or waiting; empty without a planner."""
    plan_reason: str = ""
    """Why it is not open."""


class GuardState(_OwnMessage):
    """What the guard does with the commanded velocity, and why."""

    header: Header = Header()
    state: str = ""
    """clear, slow, stop, or blind where the lidar can't be relied on."""
    factor: Float = 1.0
    """How much of the commanded velocity is let through, from 0 to 1."""
    reason: str = ""
    """In words; empty while everything is let through."""
    distance: Float = 0.0
    """From the robot's outline to the nearest point [m]; 0 also where none is known."""
    bearing: Float = 0.0
    """Of that point from base_link's x axis [rad]."""


class SimState(_OwnMessage):
    """What simulated time does; the answer of every `sim/…` query."""

    clock: Time = Time()
    tick: Count = 0
    run: UInt32 = 0
    """As in the stamps of its samples."""
    seed: UInt32 = 0
    mode: str = ""
    paused: bool = False
    speed: Float = 1.0
    rtf: Float = 0.0
    """Real-time factor since the last second or so: simulated over wall time."""
    missed_deadlines: Count = 0


class StepRequest(_OwnMessage):
    """How many ticks to simulate while paused."""

    ticks: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1


class ResetRequest(_OwnMessage):
    """Back to the start; with a new seed when one is given."""

    seed: UInt32 | None = None


class SpeedRequest(_OwnMessage):
    """Simulated seconds per wall second."""

    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0


class Parameter(_OwnMessage):
    """A setting of the configuration."""

    name: str = ""
    """As in `--set`: `follower.standoff_m`; of one of several robots `robots.two.follower…`."""
    value: str = ""
    """In TOML; of a bare word the quotes may be missing. Empty: the setting is left out."""


class Parameters(_OwnMessage):
    """What has been changed of the configuration since the start, the last change last."""

    header: Header = Header()
    revision: UInt32 = 0
    """How often it has been changed; stamps have it from the tick on from which this counts."""
    parameters: tuple[Parameter, ...] = ()


class ParameterNames(_OwnMessage):
    """Which parameters; without any, all that can be changed."""

    names: tuple[str, ...] = ()


class ParameterDescriptor(_OwnMessage):
    """A parameter that can be changed while it runs, and what is allowed."""

    name: str = ""
    value: str = ""
    """In TOML; empty where the setting is left out."""
    type: str = ""
    """bool, integer, float, string or list."""
    unit: str = ""
    range: Floats = ()
    """The least and the largest number, where both are known."""
    allowed: str = ""
    """In words."""


class ParameterDescriptors(_OwnMessage):
    """The answer to `ParameterNames`."""

    parameters: tuple[ParameterDescriptor, ...] = ()


class OdometryRequest(_OwnMessage):
    """Where the odometry should believe the robot to be, in the odometry frame."""

    pose: Pose = Pose()
