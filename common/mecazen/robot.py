"""The robot file: geometry, masses and motors of a four-wheel mecanum robot.

All properties of the robot that more than one service needs are here, in SI units
with the unit in each key. Lengths and positions are in `base_link`: origin on the ground
below the centre of the four wheels, or `wheels.centre_m` away from it; x forward, y left, z up.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from mecazen.geometry import Pose2D
from mecazen.schema import AngleDeg, Length, Mass, NonNegative, Positive, Section, WheelRadius

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
"""The order of the wheels in all tuples."""
WHEEL_JOINTS = tuple(f"{wheel}_wheel_joint" for wheel in WHEELS)
"""Default names of the wheels' joints, in the order of `WHEELS`."""
LEAST_LEVER = 0.1
"""Smallest lever of the wheels with which a robot turns, as a share of half the track."""
Name = Annotated[str, msgspec.Meta(min_length=1)]

Position = Annotated[float, msgspec.Meta(ge=-5.0, le=5.0)]
Place = Annotated[int, msgspec.Meta(ge=1, le=4)]


class Base(Section):
    """The body between the wheels: a box about their centre."""

    length_m: Length
    width_m: Length
    height_m: Length
    clearance_m: Length
    """Height of the box's underside above the ground."""
    mass_kg: Mass


class Wheels(Section):
    """The four wheels; the hub is the wheel without its rollers."""

    radius_m: WheelRadius
    """Radius of the circle that the rollers form together."""
    wheelbase_m: Length
    """Distance between the front and the rear axle."""
    track_m: Length
    """Distance between the centre planes of the left and the right wheels."""
    hub_mass_kg: Mass
    hub_width_m: Length
    max_torque_nm: Positive
    max_speed_rad_s: Positive
    centre_m: tuple[Position, Position] = (0.0, 0.0)
    """Centre of the four wheels in base_link. Twists and odometry refer to base_link."""
    joints: Annotated[tuple[Name, ...], msgspec.Meta(min_length=4, max_length=4)] = WHEEL_JOINTS
    """Joints of the front left, front right, rear left and rear right wheel, in all services."""

    wiring: tuple[int, int, int, int] = (1, 2, 3, 4)
    """Number of the motor output that drives each wheel in physics, in the order of `joints`;
    negative if its poles are swapped. Another wiring simulates a fault."""
    mounting: tuple[Place, Place, Place, Place] = (1, 2, 3, 4)
    """Number of the wheel at each place in physics, in the order of `joints`. Wheels 1 and 4 are
    alike, as are 2 and 3: with (2, 1, 4, 3) an X is mounted as an O."""

    def __post_init__(self) -> None:
        if sorted(map(abs, self.wiring)) != [1, 2, 3, 4]:
            raise ValueError(f"wheels.wiring must have 1 to 4, or negative: {self.wiring}")
        if len(set(self.joints)) != len(self.joints):
            raise ValueError(f"wheels.joints must be four different names: {self.joints}")
        x, y = map(abs, self.centre_m)
        if x > self.wheelbase_m / 2 or y > self.track_m / 2:
            raise ValueError(
                f"wheels.centre_m = {self.centre_m}: base_link is not between the wheels"
            )


class RealMotors(Section):
    """The behaviour of real motors: how the wheels follow their commands.

    A command passes the delay, the dead band, the gain and the supply, and then the lag.
    """

    delay_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    """Transport delay of commands."""
    time_constant_s: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    """Time constant of the first-order lag."""
    dead_band_rad_s: NonNegative = 0.0
    """Speed that static friction subtracts from the command: below this speed, a wheel stands
    still."""
    gains: tuple[Positive, Positive, Positive, Positive] = (1.0, 1.0, 1.0, 1.0)
    """Ratio of speed to commanded speed of each wheel, in the order of `wheels.joints`."""
    coulomb_nm: NonNegative = 0.0
    """Friction of motor and gear at any speed; the motors' effort includes it."""
    viscous_nms: NonNegative = 0.0
    """Friction of motor and gear per rad/s."""
    sag_per_nm: Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)] = 0.0
    """Relative drop of the supply voltage, and so of the speeds, per N·m of the motors' summed
    torques."""


class Rollers(Section):
    """The rollers of each wheel, all alike."""

    count: Annotated[int, msgspec.Meta(ge=4, le=40)]
    max_radius_m: WheelRadius
    """Radius of a roller at its middle."""
    mass_kg: Mass
    bearing_friction_nms: NonNegative
    """Viscous friction of a roller's bearing [N·m·s/rad]."""
    angle_deg: Annotated[float, msgspec.Meta(ge=10.0, le=80.0)] = 45.0
    """Angle between a roller's axis and the wheel's axle."""
    arrangement: Literal["X", "O"] = "X"
    """Shape that the upper rollers form, seen from above; it shows how the wheels are placed."""
    contact_friction: NonNegative = 1.0
    """Coulomb coefficient of the roller's surface; physics multiplies it by the ground's."""
    hull_spheres: Annotated[int, msgspec.Meta(ge=3, le=101)] = 81
    """Number of spheres whose convex hull is a roller's collision shape; odd, so that a sphere is
    in the middle. With fewer spheres a coasting robot slows down more."""


class Attachment(Section):
    """A sensor's housing on the base; `position_m` is its centre in base_link."""

    size_m: tuple[Length, ...]
    """Length, width, height of a box; radius, height of a cylinder."""
    position_m: tuple[Position, Position, Position]
    mass_kg: Mass

    @property
    def pose(self) -> Pose2D:
        """The pose of the housing in base_link, without its height."""
        return Pose2D(self.position_m[0], self.position_m[1])


class LidarMount(Attachment):
    """A 2D lidar, which stays level."""

    size_m: tuple[Length, Length]
    frame: Name = "lidar_link"
    """Its link and the frame of its scans."""


class CameraMount(Attachment):
    """A camera; the optical centre is the centre of the housing, which stays level."""

    size_m: tuple[Length, Length, Length]
    frame: Name = "camera_link"
    """Name of its link."""
    optical_frame: Name = "camera_depth_optical_frame"
    """The frame of its images: z ahead, x to the right, y down."""
    pitch_deg: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)] = 0.0
    """Tilt of the view: up is positive, unlike a rotation about y."""
    yaw_deg: AngleDeg = 0.0
    """Pan of the view: to the left is positive."""

    @property
    def axes(self) -> tuple[tuple[float, float, float], ...]:
        """Unit vectors in base_link (3, 3): the camera's viewing direction, left, and up."""
        yaw, pitch = math.radians(self.yaw_deg), math.radians(self.pitch_deg)
        c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
        return (cp * c, cp * s, sp), (-s, c, 0.0), (-sp * c, -sp * s, cp)


class Payload(Section):
    """A load that is fixed on the base: a homogeneous box."""

    mass_kg: Mass
    position_m: tuple[Position, Position, Position]
    """Its centre in base_link."""
    size_m: tuple[Length, Length, Length] = (0.2, 0.2, 0.2)
    """Length, width, height."""


class Robot(Section):
    """A robot file."""

    name: Annotated[str, msgspec.Meta(pattern="^[a-z][a-z0-9_]*$")]
    base: Base
    wheels: Wheels
    rollers: Rollers
    camera: CameraMount | None = None
    """If left out, the robot has no camera."""
    lidar: LidarMount | None = None
    """If left out, the robot has no lidar."""
    payload: Payload | None = None
    motors: RealMotors | None = None
    """If left out, motors are ideal and follow commands at once."""

    def __post_init__(self) -> None:
        base, wheel, roller = self.base, self.wheels, self.rollers
        if roller.max_radius_m >= wheel.radius_m / 2:
            raise ValueError(
                f"rollers.max_radius_m = {roller.max_radius_m} must be below half of "
                f"wheels.radius_m = {wheel.radius_m}"
            )
        # Two rollers meet at π/N from their middles. The wheel's circle, there R cos π/N below the
        # axle, must be below the roller's axis, which is R - r below the axle.
        thinnest = wheel.radius_m * (1.0 - math.cos(math.pi / roller.count))
        if roller.max_radius_m <= thinnest:
            raise ValueError(
                f"rollers.max_radius_m = {roller.max_radius_m} must be above {thinnest:.4g}: "
                f"{roller.count} thinner rollers on a wheel of wheels.radius_m = {wheel.radius_m} "
                "do not form a circle"
            )
        if wheel.wheelbase_m <= 2.0 * wheel.radius_m:
            raise ValueError(
                f"wheels.wheelbase_m = {wheel.wheelbase_m} must be above "
                f"{2.0 * wheel.radius_m:.4g}: front and rear wheels would overlap"
            )
        if wheel.track_m <= max(wheel.hub_width_m, base.width_m - wheel.hub_width_m):
            raise ValueError(
                f"wheels.track_m = {wheel.track_m}: the wheels would be inside the base, which is "
                "between them; with this base.width_m and wheels.hub_width_m it must be at least "
                f"{base.width_m + wheel.hub_width_m:.4g}"
            )
        if base.clearance_m >= wheel.radius_m:
            raise ValueError(
                f"base.clearance_m = {base.clearance_m} must be below wheels.radius_m = "
                f"{wheel.radius_m}: the base holds the axles"
            )
        if roller.hull_spheres % 2 == 0:
            raise ValueError(
                f"rollers.hull_spheres = {roller.hull_spheres} must be odd: "
                "without a sphere in its middle a roller is too thin there"
            )
        if abs(self.lever) < LEAST_LEVER * self.half_track:
            raise ValueError(
                f"rollers.arrangement = {roller.arrangement!r}: such a robot can hardly turn, as "
                f"its wheels have a lever of {self.lever:.3g} m; another wheelbase_m, track_m or "
                "arrangement is needed"
            )
        frames = [mount.frame for mount in (self.camera, self.lidar) if mount is not None]
        frames += ["base_link"] if self.camera is None else ["base_link", self.camera.optical_frame]
        if len(set(frames)) != len(frames):
            raise ValueError(f"camera and lidar: each frame must have its own name: {frames}")
        if self.payload is not None:
            lowest = self.payload.position_m[2] - self.payload.size_m[2] / 2
            if lowest < self.base.clearance_m:
                raise ValueError(
                    f"payload.position_m: its underside would be {lowest:.3g} m above the ground, "
                    f"below that of the base, {self.base.clearance_m} m"
                )

    @property
    def half_wheelbase(self) -> float:
        """Half the distance between the axles [m]."""
        return self.wheels.wheelbase_m / 2

    @property
    def half_track(self) -> float:
        """Half the distance between left and right wheels [m]."""
        return self.wheels.track_m / 2

    @property
    def footprint(self) -> tuple[float, float]:
        """Half the length and width [m] of a rectangle about base_link that holds the robot.

        A wheel reaches as far as its radius R along x. Along its axle, every point of a roller
        is on a sphere about the roller's axis, of at most the roller's largest radius r, that
        touches the wheel's circle at a wheel angle |φ| <= π/N, of N rollers. With the angle γ
        between the axes, d = R - r between them, the sphere's centre is d·tan φ/tan γ from the
        wheel's middle (Gfrerer, Geometry and kinematics of the Mecanum wheel, 2008).

        Along the axle, R is used if it is larger, as a margin for contacts.
        """
        radius, thickest = self.wheels.radius_m, self.rollers.max_radius_m
        end = math.tan(math.pi / self.rollers.count) / math.tan(self.roller_angle)
        roller = (radius - thickest) * end + thickest
        x, y = map(abs, self.wheels.centre_m)
        length = max(self.half_wheelbase + radius, self.base.length_m / 2) + x
        width = self.half_track + max(roller, radius, self.wheels.hub_width_m / 2)
        width = max(width, self.base.width_m / 2) + y
        if self.payload is not None:
            (x, y, _), (along, across, _) = self.payload.position_m, self.payload.size_m
            length, width = max(length, abs(x) + along / 2), max(width, abs(y) + across / 2)
        return length, width

    @property
    def height(self) -> float:
        """Height of the robot's highest point above the ground [m]."""
        tops = [self.base.clearance_m + self.base.height_m, 2.0 * self.wheels.radius_m]
        for part in (self.camera, self.lidar, self.payload):
            if part is not None:
                tops.append(part.position_m[2] + part.size_m[-1] / 2)
        return max(tops)

    @property
    def roller_angle(self) -> float:
        """Angle between a roller's axis and the wheel's axle [rad]."""
        return math.radians(self.rollers.angle_deg)

    @property
    def cross_gain(self) -> float:
        """Speed of a wheel's rim per speed of the robot to the side: ±cot γ.

        γ is the angle between the axes of roller and wheel. The gain is negative if the rollers are
        arranged as an O.
        """
        sign = 1.0 if self.rollers.arrangement == "X" else -1.0
        # tan 45° is not quite 1 in floating point
        return sign * (1.0 if self.rollers.angle_deg == 45.0 else 1.0 / math.tan(self.roller_angle))

    @property
    def lever(self) -> float:
        """Speed of a wheel's rim per yaw rate of the robot about the wheels' centre [m]."""
        return self.half_track + self.cross_gain * self.half_wheelbase

    @property
    def swing(self) -> float:
        """Speed of the fastest rim per yaw rate about base_link, in addition to `lever` [m]."""
        x, y = map(abs, self.wheels.centre_m)
        return y + abs(self.cross_gain) * x

    def wheel_position(self, wheel: str) -> tuple[float, float, float]:
        """Return the centre of `wheel` (a name of `WHEELS`) in base_link [m]."""
        x, y = self.wheels.centre_m
        x += self.half_wheelbase if wheel.startswith("front") else -self.half_wheelbase
        y += self.half_track if wheel.endswith("left") else -self.half_track
        return x, y, self.wheels.radius_m


def roller_joint(wheel: str, index: int) -> str:
    """Return the joint name of roller `index` (from 0) of a wheel."""
    return f"{wheel}_roller_{index:02d}_joint"
