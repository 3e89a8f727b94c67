"""The physics section of a scenario."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from mecazen.schema import AngleDeg, Finite, NonNegative, Positive, Section


class Box(Section, tag_field="kind", tag="box", frozen=True, kw_only=True):
    """A static box that stands on the ground, higher than the wheels' axles."""

    size_m: tuple[Positive, Positive, Positive]
    """Length (x), width (y), height (z)."""
    position_m: tuple[Finite, Finite]
    """Its middle in the world frame."""
    yaw_deg: AngleDeg = 0.0
    """Its heading in the world frame."""
    friction: NonNegative = 1.0
    """Coulomb coefficient between it and the robot."""


class Cylinder(Section, tag_field="kind", tag="cylinder", frozen=True, kw_only=True):
    """A static upright cylinder that stands on the ground, higher than the wheels' axles."""

    size_m: tuple[Positive, Positive]
    """Radius, height."""
    position_m: tuple[Finite, Finite]
    """Its middle in the world frame."""
    friction: NonNegative = 1.0
    """Coulomb coefficient between it and the robot."""


class Person(Section, frozen=True, kw_only=True):
    """The body that the robot can touch: an upright cylinder that the robot cannot move."""

    radius_m: Positive = 0.2
    """Radius of the cylinder."""
    height_m: Positive = 1.75
    """Height of the cylinder."""
    friction: NonNegative = 0.5
    """Coulomb coefficient between it and the robot."""


class Pid(Section, frozen=True, kw_only=True):
    """Wheel speed to torque, as ROS's effort_controllers/JointVelocityController."""

    p_nms: NonNegative = 2.0
    """Proportional gain [N·m per rad/s]."""
    i_nm: NonNegative = 10.0
    """Integral gain [N·m per rad/s and second]."""
    d_nms2: NonNegative = 0.0
    """Derivative gain [N·m per rad/s²]."""
    i_clamp_nm: NonNegative = 2.0
    """Largest torque of the integral part."""


class PhysicsConfig(Section, frozen=True, kw_only=True):
    """The simulated world round the robot.

    Raises:
        ValueError: for a combination that cannot be simulated.
    """

    dt_s: Annotated[float, msgspec.Meta(ge=1e-5, le=0.005)] = 0.001
    """One physics step; a control period holds a whole number of them."""
    roller_spheres: Annotated[int, msgspec.Meta(ge=3, le=101)] = 41
    """Spheres whose convex hull is a roller's collision shape; odd: one in its middle."""
    rollers: Literal["near", "all"] = "near"
    """Bodies are the rollers that can touch anything soon ("near") or always all of them: the
    same robot, at less than half the speed."""
    drive: Literal["velocity", "effort"] = "velocity"
    """A commanded wheel speed is held by an ideal servo within the motor's torque
    ("velocity") or by a PID controller in the physics loop ("effort")."""
    pid: Pid = Pid()
    """Gains of the drive "effort"."""
    ground_friction: NonNegative = 1.0
    """Coulomb coefficient of the ground; the rollers' own multiplies it."""
    slope_deg: Annotated[float, msgspec.Meta(ge=0.0, le=45.0)] = 0.0
    """Steepness of the ground. The world frame is the ground's: gravity leans."""
    slope_heading_deg: AngleDeg = 0.0
    """Direction uphill in the world frame."""
    obstacles: tuple[Box | Cylinder, ...] = ()
    """Static bodies."""
    person: Person = Person()
    """The body of the person that the robot follows."""
    watchdog_s: Positive = 0.5
    """Simulated time without a wheel command after which the wheels are stopped; and without
    a word of the person, after which they stand."""

    def __post_init__(self) -> None:
        if self.roller_spheres % 2 == 0:
            raise ValueError(
                f"physics.roller_spheres = {self.roller_spheres} must be odd: "
                "without a sphere in its middle a roller is too thin there"
            )
        if self.watchdog_s < self.dt_s:
            raise ValueError(
                f"physics.watchdog_s = {self.watchdog_s} must not be below "
                f"physics.dt_s = {self.dt_s}"
            )
