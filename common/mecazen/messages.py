"""The messages: frozen structs, field for field ROS's, with ROS's defaults for what is missing.

Vectors are in metres and radians (or their rates) in the frame that the message or its
header names. Numbers must be finite; unknown fields are ignored when decoding.
Types under `mecazen_msgs` have no equal in ROS. The bounds of a field also tell its type in ROS:
see `mecazen.ros.fields`.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, dataclass_transform

import msgspec

from mecazen.geometry import Pose2D, Twist2D, of_three, rotate

# msgspec's JSON refuses NaN and Infinity, its MessagePack does not: the bounds refuse both.
Float = Annotated[float, msgspec.Meta(ge=-1.797e308, le=1.797e308)]
Int32 = Annotated[int, msgspec.Meta(ge=-(2**31), le=2**31 - 1)]
Float32 = Annotated[float, msgspec.Meta(ge=-3.4028234663852886e38, le=3.4028234663852886e38)]
"""A number that ROS holds in 32 bits: whoever makes it rounds it, so that a recording has the
same bits."""
UInt8 = Annotated[int, msgspec.Meta(ge=0, le=255)]
UInt32 = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
Floats = tuple[Float, ...]
Covariance = Annotated[tuple[Float, ...], msgspec.Meta(min_length=36, max_length=36)]
"""Row-major 6x6 over (x, y, z, rotation about x, y, z)."""
Matrix3 = Annotated[tuple[Float, ...], msgspec.Meta(min_length=9, max_length=9)]
"""Row-major 3x3."""
Matrix34 = Annotated[tuple[Float, ...], msgspec.Meta(min_length=12, max_length=12)]
"""Row-major 3x4."""

NO_COVARIANCE: tuple[float, ...] = (0.0,) * 36


@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Message(msgspec.Struct, frozen=True):
    """Base of all messages."""

    ROS_TYPE: ClassVar[str]
    ROS_CONSTANTS: ClassVar[tuple[str, ...]] = ()
    """Lines of ROS's definition: the values that a field may have."""


class Time(Message):
    """Simulated time since the start of the run."""

    ROS_TYPE: ClassVar[str] = "builtin_interfaces/msg/Time"
    sec: Int32 = 0
    nanosec: Annotated[int, msgspec.Meta(ge=0, lt=10**9)] = 0

    @classmethod
    def from_ns(cls, time_ns: int) -> Time:
        """Return the time of `time_ns` nanoseconds."""
        sec, nanosec = divmod(time_ns, 10**9)
        return cls(sec=sec, nanosec=nanosec)

    @property
    def ns(self) -> int:
        """The time in nanoseconds."""
        return self.sec * 10**9 + self.nanosec


class Header(Message):
    """When the data is of, and in which frame."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/Header"
    stamp: Time = Time()
    frame_id: str = ""


class String(Message):
    """A text."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/String"
    data: str = ""


class Clock(Message):
    """Simulated time."""

    ROS_TYPE: ClassVar[str] = "rosgraph_msgs/msg/Clock"
    clock: Time = Time()


class Vector3(Message):
    """A free vector."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Vector3"
    x: Float = 0.0
    y: Float = 0.0
    z: Float = 0.0


class Point(Message):
    """A position [m]."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Point"
    x: Float = 0.0
    y: Float = 0.0
    z: Float = 0.0


class Quaternion(Message):
    """An orientation; the identity by default."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Quaternion"
    x: Float = 0.0
    y: Float = 0.0
    z: Float = 0.0
    w: Float = 1.0


class Twist(Message):
    """Linear [m/s] and angular [rad/s] velocity."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Twist"
    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()

    @classmethod
    def planar(cls, twist: Twist2D) -> Twist:
        """Return a planar velocity as a Twist."""
        return cls(linear=Vector3(x=twist.x, y=twist.y), angular=Vector3(z=twist.yaw))

    def to_planar(self) -> Twist2D:
        """Return the planar part."""
        return of_three(Twist2D, (self.linear.x, self.linear.y, self.angular.z))


class Pose(Message):
    """Position [m] and orientation."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Pose"
    position: Point = Point()
    orientation: Quaternion = Quaternion()

    @classmethod
    def planar(cls, pose: Pose2D) -> Pose:
        """Return a planar pose as a Pose on the ground."""
        return cls(
            position=Point(x=pose.x, y=pose.y),
            orientation=Quaternion(z=math.sin(pose.yaw / 2), w=math.cos(pose.yaw / 2)),
        )

    def to_planar(self) -> Pose2D:
        """Return x, y and the yaw angle; a tilt is projected out.

        The yaw of R_z(yaw) R_y R_x is atan2(2(wz + xy), 1 - 2(y² + z²)); written
        homogeneously it holds for a quaternion of any length.
        """
        q = self.orientation
        x, y, z, w = q.x, q.y, q.z, q.w
        if math.hypot(x, y, z, w) > 1e100:  # whose square may be infinite
            longest = max(abs(x), abs(y), abs(z), abs(w))
            x, y, z, w = x / longest, y / longest, z / longest, w / longest
        yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return of_three(Pose2D, (self.position.x, self.position.y, yaw))


class PoseWithCovariance(Message):
    """A pose and how certain it is."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/PoseWithCovariance"
    pose: Pose = Pose()
    covariance: Covariance = NO_COVARIANCE


class TwistWithCovariance(Message):
    """A velocity and how certain it is."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/TwistWithCovariance"
    twist: Twist = Twist()
    covariance: Covariance = NO_COVARIANCE


class Odometry(Message):
    """Pose in header.frame_id, and velocity in child_frame_id."""

    ROS_TYPE: ClassVar[str] = "nav_msgs/msg/Odometry"
    header: Header = Header()
    child_frame_id: str = ""
    pose: PoseWithCovariance = PoseWithCovariance()
    twist: TwistWithCovariance = TwistWithCovariance()


class JointState(Message):
    """Positions [rad], velocities [rad/s] and efforts [N·m] of named joints; each may be empty."""

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/JointState"
    header: Header = Header()
    name: tuple[str, ...] = ()
    position: Floats = ()
    velocity: Floats = ()
    effort: Floats = ()


class LaserScan(Message):
    """A planar scan: beam `i` at the angle angle_min + i angle_increment about z [rad].

    REP-117's infinities are not finite and so no numbers here; its test `range_min <= r <=
    range_max` tells what is measured all the same. No return within range (+Inf in REP-117) is
    range_max + 1; a beam without a valid measurement (NaN) is 0, as many drivers have it.
    """

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/LaserScan"
    header: Header = Header()
    angle_min: Float32 = 0.0
    angle_max: Float32 = 0.0
    angle_increment: Float32 = 0.0
    time_increment: Float32 = 0.0
    scan_time: Float32 = 0.0
    range_min: Float32 = 0.0
    range_max: Float32 = 0.0
    ranges: tuple[Float32, ...] = ()
    intensities: tuple[Float32, ...] = ()


class Image(Message):
    """A picture, row by row from the top; `data` is base64 in JSON."""

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/Image"
    header: Header = Header()
    height: UInt32 = 0
    width: UInt32 = 0
    encoding: str = ""
    is_bigendian: UInt8 = 0
    step: UInt32 = 0
    data: bytes = b""


class RegionOfInterest(Message):
    """A part of a picture; all zero is the whole."""

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/RegionOfInterest"
    x_offset: UInt32 = 0
    y_offset: UInt32 = 0
    height: UInt32 = 0
    width: UInt32 = 0
    do_rectify: bool = False


class CameraInfo(Message):
    """How a camera projects: k and p in pixels, in its optical frame (z ahead, x right, y down)."""

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/CameraInfo"
    header: Header = Header()
    height: UInt32 = 0
    width: UInt32 = 0
    distortion_model: str = ""
    d: Floats = ()
    k: Matrix3 = (0.0,) * 9
    r: Matrix3 = (0.0,) * 9
    p: Matrix34 = (0.0,) * 12
    binning_x: UInt32 = 0
    binning_y: UInt32 = 0
    roi: RegionOfInterest = RegionOfInterest()


class Skeleton(Message):
    """The body of a person: joints in header.frame_id, in the order of `mecazen.skeleton.JOINTS`.

    The truth leaves `std` and `confidence` empty; a tracker leaves empty what it does not measure.
    """

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/Skeleton"
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


class Skeletons(Message):
    """One frame of a body tracker: everybody seen, in any order; none if nobody was.

    header.stamp is when the frame was taken; the message comes later by the tracker's latency.
    """

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/Skeletons"
    header: Header = Header()
    skeletons: tuple[Skeleton, ...] = ()


class Person(Message):
    """Where somebody truly is, in the frame of a `People`."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/Person"
    id: str = ""
    pose: Pose = Pose()
    twist: Twist = Twist()
    """In the person's own frame: x forward, y left."""
    height: Float = 0.0
    """Of the body [m]; 0 where it is not known."""
    joints: tuple[Point, ...] = ()
    """In the order of `mecazen.skeleton.JOINTS`; empty where no sensor looks at them."""


class NamedPose(Message):
    """Where the robot of a name truly is."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/NamedPose"
    name: str = ""
    pose: Pose = Pose()


class People(Message):
    """Everybody in the world: the persons that robots follow, all others, and the robots."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/People"
    header: Header = Header()
    persons: tuple[Person, ...] = ()
    """First those whom robots follow, by the robots' names ("target" of a single one)."""
    robots: tuple[NamedPose, ...] = ()


class KeyValue(Message):
    """A named value."""

    ROS_TYPE: ClassVar[str] = "diagnostic_msgs/msg/KeyValue"
    key: str = ""
    value: str = ""


class DiagnosticStatus(Message):
    """The health of one thing: level 0 ok, 1 warning, 2 error, 3 stale."""

    ROS_TYPE: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticStatus"
    ROS_CONSTANTS: ClassVar[tuple[str, ...]] = (
        "byte OK=0",
        "byte WARN=1",
        "byte ERROR=2",
        "byte STALE=3",
    )
    level: Annotated[int, msgspec.Meta(ge=0, le=3, extra={"ros": "byte"})] = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: tuple[KeyValue, ...] = ()


class DiagnosticArray(Message):
    """The health of one service."""

    ROS_TYPE: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticArray"
    header: Header = Header()
    status: tuple[DiagnosticStatus, ...] = ()


class Observation(Message):
    """One frame of the robot's person sensor: everybody seen, in any order; none if nobody was.

    header.stamp is when the frame was taken; the message comes later by the sensor's latency.
    """

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/Observation"
    header: Header = Header()
    poses: tuple[PoseWithCovariance, ...] = ()
    ids: tuple[str, ...] = ()
    """The sensor's name for each of them; empty if it tells nobody apart."""


class FollowerState(Message):
    """What the follower believes and wants; poses and velocities in header.frame_id."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/FollowerState"
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


class GuardState(Message):
    """What the guard does with the commanded velocity, and why."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/GuardState"
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


class SimState(Message):
    """What simulated time does; the answer of every `sim/…` query."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/SimState"
    clock: Time = Time()
    tick: Count = 0
    seed: UInt32 = 0
    mode: str = ""
    paused: bool = False
    speed: Float = 1.0
    rtf: Float = 0.0
    """Real-time factor since the last second or so: simulated over wall time."""
    missed_deadlines: Count = 0


class Empty(Message):
    """A request without arguments."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/Empty"


class StepRequest(Message):
    """How many ticks to simulate while paused."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/StepRequest"
    ticks: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1


class ResetRequest(Message):
    """Back to the start; with a new seed when one is given."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/ResetRequest"
    seed: UInt32 | None = None


class SpeedRequest(Message):
    """Simulated seconds per wall second."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/SpeedRequest"
    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0


class Parameter(Message):
    """A setting of the configuration."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/Parameter"
    name: str = ""
    """As in `--set`: `follower.standoff_m`; of one of several robots `robots.two.follower…`."""
    value: str = ""
    """In TOML; of a bare word the quotes may be missing. Empty: the setting is left out."""


class Parameters(Message):
    """What has been changed of the configuration since the start, the last change last."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/Parameters"
    header: Header = Header()
    revision: UInt32 = 0
    """How often it has been changed; stamps have it from the tick on from which this counts."""
    parameters: tuple[Parameter, ...] = ()


class ParameterNames(Message):
    """Which parameters; without any, all that can be changed."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/ParameterNames"
    names: tuple[str, ...] = ()


class ParameterDescriptor(Message):
    """A parameter that can be changed while it runs, and what is allowed."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/ParameterDescriptor"
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


class ParameterDescriptors(Message):
    """The answer to `ParameterNames`."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/ParameterDescriptors"
    parameters: tuple[ParameterDescriptor, ...] = ()


class OdometryRequest(Message):
    """Where the odometry should believe the robot to be, in the odometry frame."""

    ROS_TYPE: ClassVar[str] = "mecazen_msgs/msg/OdometryRequest"
    pose: Pose = Pose()


def planar_odometry(
    stamp: Time,
    frame_id: str,
    child_frame_id: str,
    pose: Pose2D,
    twist: Twist2D,
    pose_covariance: tuple[float, ...] = NO_COVARIANCE,
    twist_covariance: tuple[float, ...] = NO_COVARIANCE,
) -> Odometry:
    """Return planar motion as an Odometry; `twist` is in the child frame."""
    return Odometry(
        header=Header(stamp=stamp, frame_id=frame_id),
        child_frame_id=child_frame_id,
        pose=PoseWithCovariance(pose=Pose.planar(pose), covariance=pose_covariance),
        twist=TwistWithCovariance(twist=Twist.planar(twist), covariance=twist_covariance),
    )


def world_twist(odometry: Odometry) -> Twist2D:
    """Return the planar velocity of an Odometry, turned from its child frame to its frame."""
    twist = odometry.twist.twist.to_planar()
    return Twist2D(*rotate(twist.x, twist.y, odometry.pose.pose.to_planar().yaw), twist.yaw)
