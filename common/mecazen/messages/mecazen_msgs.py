"""Messages of `mecazen_msgs`, which have no equal in ROS."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import msgspec

from mecazen.messages.ros import (
    Coordinate,
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


class Unseen(StrEnum):
    """Why the followed person is not seen: the words of each field `reason` but the guard's."""

    LEFT = "out of view to the left"
    RIGHT = "out of view to the right"
    SHOULDERS = "shoulders not in the camera's view"
    BELOW = "below the camera's view"
    TOO_NEAR = "too near"
    TOO_FAR = "out of range"
    OBSTACLE = "hidden by an obstacle"
    WALL = "hidden by a wall"
    PERSON = "hidden by another person"
    ROBOT = "hidden by another robot"
    BLIND = "the sensor sees nothing"  # as configured
    IMPLAUSIBLE = "only implausible detections"
    EMPTY = "not in the sensor's frames"  # although in view, by the estimate
    NO_FRAMES = "no frames from the sensor"


class Skeleton(Message):
    """The body of a person: joints in header.frame_id, in the order of `mecazen.skeleton.JOINTS`.

    The truth leaves `std` and `confidence` empty; a tracker leaves unmeasured fields empty.
    """

    header: Header = Header()
    id: str = ""
    height: Float = 0.0
    """Height of the body [m]; 0 if it is not known."""
    joints: tuple[Point, ...] = ()
    std: tuple[Coordinate, ...] = ()
    """Standard deviation of each joint along any axis [m]."""
    confidence: tuple[UInt32, ...] = ()
    """Confidence of each joint, as in k4abt: 0 none (out of view), 1 low (occluded), 2 medium."""
    angles: Floats = ()
    """Sagittal angles in the order of `mecazen.skeleton.ANGLES` [rad]."""
    phases: Floats = ()
    """Share of the gait cycle since the last foot strike, left and right."""


class Skeletons(Message):
    """One frame of a body tracker: all persons seen, in any order; empty if no person was seen.

    header.stamp is the time of capture; the message comes later by the tracker's latency.
    """

    header: Header = Header()
    skeletons: tuple[Skeleton, ...] = ()
    reason: str = ""
    """Why the followed person is not in the frame: a word of `Unseen`; empty if unknown."""


class Person(Message):
    """True pose of a person, in the frame of a `People`."""

    id: str = ""
    pose: Pose = Pose()
    twist: Twist = Twist()
    """Velocity in the person's own frame: x forward, y left."""
    height: Float = 0.0
    """Height of the body [m]; 0 if it is not known."""
    joints: tuple[Point, ...] = ()
    """Joints in the order of `mecazen.skeleton.JOINTS`; empty if no sensor perceives them."""


class NamedPose(Message):
    """Name and true pose of a robot."""

    name: str = ""
    pose: Pose = Pose()


class People(Message):
    """All persons in the world (those that robots follow, then all others), and the robots."""

    header: Header = Header()
    persons: tuple[Person, ...] = ()
    """First the persons whom robots follow; their ids are the robots' names, or "target"."""
    robots: tuple[NamedPose, ...] = ()


class Observation(Message):
    """One frame of the robot's person sensor: all persons seen, in any order; empty if none was.

    header.stamp is the time of capture; the message comes later by the sensor's latency.
    """

    header: Header = Header()
    poses: tuple[PoseWithCovariance, ...] = ()
    ids: tuple[str, ...] = ()
    """The sensor's name for each person; empty if the sensor does not distinguish persons."""
    reason: str = ""
    """Why the followed person is not in the frame: a word of `Unseen`; empty if unknown."""


class FollowerState(Message):
    """The follower's estimate, goal and errors; poses and velocities in header.frame_id."""

    header: Header = Header()
    tracking: str = ""
    """waiting, following, coasting, searching or lost."""
    reason: str = ""
    """Why the person is not seen, or after a loss why they got lost: a word of `Unseen`, or that of
    the sensor; empty while following."""
    estimator: str = ""
    estimate: tuple[Odometry, ...] = ()
    """The person; empty until first seen."""
    goal: tuple[Pose, ...] = ()
    """Goal pose of the robot; empty until the person is first seen."""
    distance_error: Float = 0.0
    """Distance to the estimate minus the standoff distance [m]."""
    bearing_error: Float = 0.0
    """Bearing of the robot as seen from the person, minus that of the goal [rad]."""
    heading_error: Float = 0.0
    """Heading of the robot minus that of the goal [rad]."""
    last_seen_s: Float = 0.0
    """Simulated time since the last frame that showed the person [s]."""
    plan: str = ""
    """open (nothing is near), avoiding, gave_up_distance, gave_up_visibility, gave_up_bearing,
    gave_up_heading or waiting; empty without a planner. While the person is lost, searching, or
    waiting at the end of the search."""
    plan_reason: str = ""
    """Reason for a plan other than open; what a robot that searches looks at."""


class GuardState(Message):
    """The guard's action on the commanded velocity, and its reason."""

    header: Header = Header()
    state: str = ""
    """clear, slow, stop, or blind if the lidar can't be relied on."""
    factor: Float = 1.0
    """Share of the commanded velocity that is let through, from 0 to 1."""
    reason: str = ""
    """Reason in words; empty while everything is let through."""
    distance: Float = 0.0
    """Distance from the robot's outline to the nearest point [m]; 0 also if no point is known."""
    bearing: Float = 0.0
    """Bearing of that point from base_link's x axis [rad]."""


class SimState(Message):
    """State of simulated time; the answer to `sim/state` and to the queries that control time."""

    clock: Time = Time()
    tick: Count = 0
    run: UInt32 = 0
    """Number of the run, as in the stamps of its samples."""
    seed: UInt32 = 0
    mode: str = ""
    paused: bool = False
    speed: Float = 1.0
    rtf: Float = 0.0
    """Real-time factor since the last second or so: simulated over wall time."""
    missed_deadlines: Count = 0


class StepRequest(Message):
    """Request to simulate a number of ticks while paused."""

    ticks: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1


class ResetRequest(Message):
    """Request to return to the start, with a new seed if one is given."""

    seed: UInt32 | None = None


class SpeedRequest(Message):
    """Request for a number of simulated seconds per wall second."""

    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0


class Parameter(Message):
    """A setting of the configuration."""

    name: str = ""
    """Name as in `--set`: `follower.standoff_m`; for one of several robots
    `robots.two.follower…`."""
    value: str = ""
    """Value in TOML; a bare word needs no quotes. Empty: the setting is left out."""


class Parameters(Message):
    """Changes of the configuration since the start, the last change last."""

    header: Header = Header()
    parameters: tuple[Parameter, ...] = ()


class ParameterNames(Message):
    """Names of the requested parameters; empty: all that can be changed."""

    names: tuple[str, ...] = ()


class ParameterDescriptor(Message):
    """A parameter that can be changed while the simulation runs, and its allowed values."""

    name: str = ""
    value: str = ""
    """Value in TOML; empty if the setting is left out."""
    type: str = ""
    """bool, integer, float, string or list."""
    unit: str = ""
    range: Floats = ()
    """Smallest and largest number, if both are known."""
    allowed: str = ""
    """Allowed values in words."""


class ParameterDescriptors(Message):
    """The answer to `ParameterNames`."""

    parameters: tuple[ParameterDescriptor, ...] = ()


class OdometryRequest(Message):
    """Request to set the odometry to a pose of the robot, in the odometry frame."""

    pose: Pose = Pose()
