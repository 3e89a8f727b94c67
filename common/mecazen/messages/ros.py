"""ROS's own messages.

Vectors are in metres and radians (or their rates) in the frame that the message or its
header names. Numbers must be finite, and an unknown field is refused when decoding.
The bounds of a field also determine its type in ROS.
"""

from __future__ import annotations

import math
from operator import itemgetter
from typing import Annotated, Any, ClassVar, TypeVar, dataclass_transform

import msgspec

from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, Twist2D

# CDR may hold NaN and Infinity, which JSON lacks: the bounds refuse both
Float = Annotated[float, msgspec.Meta(ge=-1.797e308, le=1.797e308)]
FARTHEST = 1e7
"""Largest coordinate [m] and component of a velocity [m/s, rad/s]; UTM has coordinates of 1e7."""
Coordinate = Annotated[float, msgspec.Meta(ge=-FARTHEST, le=FARTHEST)]
Int32 = Annotated[int, msgspec.Meta(ge=-(2**31), le=2**31 - 1)]
Float32 = Annotated[float, msgspec.Meta(ge=-3.4028234663852886e38, le=3.4028234663852886e38)]
"""A number that ROS stores in 32 bits. Its producer rounds it, so that a recording is
bit-identical."""
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
PlanarCovariance = tuple[tuple[float, ...], ...]
"""3x3 over x [m], y [m] and yaw [rad], row by row."""
planar_entries = itemgetter(0, 1, 5, 6, 7, 11, 30, 31, 35)
"""Takes the entries of x, y and yaw from a row-major 6x6; the others may be 1e99: "unknown"."""


@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all messages."""

    ROS_TYPE: ClassVar[str]
    """Type in ROS; by default the package is the module's name: `mecazen_msgs/msg/Person`."""

    def __init_subclass__(cls) -> None:
        if "ROS_TYPE" not in vars(cls):
            cls.ROS_TYPE = f"{cls.__module__.rpartition('.')[2]}/msg/{cls.__name__}"


MessageT = TypeVar("MessageT", bound=Message)


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
    """Time and frame of the data."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/Header"
    stamp: Time = Time()
    frame_id: str = ""


class String(Message):
    """A text."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/String"
    data: str = ""


class Bool(Message):
    """True or false."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/Bool"
    data: bool = False


class Clock(Message):
    """Simulated time."""

    ROS_TYPE: ClassVar[str] = "rosgraph_msgs/msg/Clock"
    clock: Time = Time()


class Vector3(Message):
    """A free vector."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Vector3"
    x: Coordinate = 0.0
    y: Coordinate = 0.0
    z: Coordinate = 0.0


class Point(Message):
    """A position [m]."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Point"
    x: Coordinate = 0.0
    y: Coordinate = 0.0
    z: Coordinate = 0.0


class Quaternion(Message):
    """An orientation; the identity by default."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Quaternion"
    x: Coordinate = 0.0
    y: Coordinate = 0.0
    z: Coordinate = 0.0
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
        return Twist2D(self.linear.x, self.linear.y, self.angular.z)


class TwistStamped(Message):
    """A Twist with a header, which is accepted in place of a Twist."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/TwistStamped"
    header: Header = Header()
    twist: Twist = Twist()


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
        if math.hypot(x, y, z, w) > 1e100:  # the square may be infinite
            longest = max(abs(x), abs(y), abs(z), abs(w))
            x, y, z, w = x / longest, y / longest, z / longest, w / longest
        yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return Pose2D(self.position.x, self.position.y, yaw)


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
    velocity: tuple[Coordinate, ...] = ()
    effort: Floats = ()


class LaserScan(Message):
    """A planar scan: beam `i` at the angle angle_min + i angle_increment about z [rad].

    Numbers must be finite; `finite_scan` replaces the others. REP-117's test `range_min <= r <=
    range_max` finds the measured ranges. No return within range (+Inf in REP-117) is range_max + 1;
    an object below range_min (-Inf) is any range between 0 and range_min; a beam without a valid
    measurement (NaN) is 0. `mecazen.scan` reads drivers that send 0 or NaN for no return as well.
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


def finite_scan(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a scan from ROS with finite ranges; in JSON, bridges send null instead.

    Intensities are left out, since theirs may be infinite too.
    """
    ranges, least, most = (fields.get(name) for name in ("ranges", "range_min", "range_max"))
    if not isinstance(ranges, list | tuple):
        return fields
    if not isinstance(least, float | int) or not isinstance(most, float | int):
        return fields

    def finite(value: Any) -> Any:
        if value is None:
            return 0.0
        if not isinstance(value, float) or math.isfinite(value):
            return value
        return 0.0 if math.isnan(value) else most + 1.0 if value > 0.0 else least / 2.0

    return fields | {"ranges": tuple(map(finite, ranges)), "intensities": ()}


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
    """A part of a picture; all zeros mean the whole picture."""

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


class Imu(Message):
    """Angular velocity [rad/s] and specific force [m/s²] in header.frame_id, with covariances.

    The orientation is not measured if the first number of its covariance is -1.
    """

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/Imu"
    header: Header = Header()
    orientation: Quaternion = Quaternion()
    orientation_covariance: Matrix3 = (0.0,) * 9
    angular_velocity: Vector3 = Vector3()
    angular_velocity_covariance: Matrix3 = (0.0,) * 9
    linear_acceleration: Vector3 = Vector3()
    linear_acceleration_covariance: Matrix3 = (0.0,) * 9


class BatteryState(Message):
    """Voltage [V], current [A] (negative: discharging), charge [A·h] and health of a battery.

    A quantity other than the voltage is 0 if it is not measured; ROS uses NaN instead.
    """

    ROS_TYPE: ClassVar[str] = "sensor_msgs/msg/BatteryState"
    header: Header = Header()
    voltage: Float32 = 0.0
    temperature: Float32 = 0.0
    current: Float32 = 0.0
    charge: Float32 = 0.0
    capacity: Float32 = 0.0
    design_capacity: Float32 = 0.0
    percentage: Float32 = 0.0
    power_supply_status: UInt8 = 0
    power_supply_health: UInt8 = 0
    power_supply_technology: UInt8 = 0
    present: bool = False
    cell_voltage: tuple[Float32, ...] = ()
    cell_temperature: tuple[Float32, ...] = ()
    location: str = ""
    serial_number: str = ""


class KeyValue(Message):
    """A named value."""

    ROS_TYPE: ClassVar[str] = "diagnostic_msgs/msg/KeyValue"
    key: str = ""
    value: str = ""


class DiagnosticStatus(Message):
    """The health of one thing: level 0 ok, 1 warning, 2 error, 3 stale."""

    ROS_TYPE: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticStatus"
    level: Annotated[int, msgspec.Meta(ge=0, le=3)] = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: tuple[KeyValue, ...] = ()


class DiagnosticArray(Message):
    """The health of one service."""

    ROS_TYPE: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticArray"
    header: Header = Header()
    status: tuple[DiagnosticStatus, ...] = ()


class Empty(Message, forbid_unknown_fields=False):
    """A request without arguments; it is obeyed whatever it contains."""

    ROS_TYPE: ClassVar[str] = "std_msgs/msg/Empty"


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


def planar_covariance(covariance: tuple[float, ...]) -> PlanarCovariance:
    """Return the 3x3 over (x, y, yaw) of ROS's row-major 6x6.

    Raises:
        RefusedError: It has another size.
    """
    if len(covariance) != 36:
        raise RefusedError(f"a covariance has 36 numbers, not {len(covariance)}")
    xx, xy, xw, yx, yy, yw, wx, wy, ww = planar_entries(covariance)
    return (xx, xy, xw), (yx, yy, yw), (wx, wy, ww)


def ros_covariance(planar: PlanarCovariance) -> tuple[float, ...]:
    """Return ROS's row-major 6x6 of a 3x3 over (x, y, yaw); other entries are 0."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = planar
    zeros = 0.0, 0.0, 0.0
    return (xx, xy, *zeros, xw, yx, yy, *zeros, yw, *6 * zeros, wx, wy, *zeros, ww)


def diagonal_covariance(variances: tuple[float, ...]) -> tuple[float, ...]:
    """Return ROS's row-major 6x6 with the six variances of x, y, z, roll, pitch and yaw."""
    return tuple(
        variances[row] if row == column else 0.0 for row in range(6) for column in range(6)
    )
