"""`[sim]`, `[physics]`, `[controller]`, `[hardware]`, `[viewer]` and `[recorder]`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from mecazen.schema import (
    Length,
    Live,
    NonNegative,
    OutputFile,
    Positive,
    Program,
    Section,
    WheelRadius,
)


class SimConfig(Section):
    """Simulated time."""

    mode: Literal["real_time", "lockstep"] = "real_time"
    """real_time follows the wall clock; lockstep waits for every answer, not for the wall clock."""
    tick_s: Annotated[float, msgspec.Meta(ge=0.001, le=1.0)] = 0.01
    """The control period; a multiple of 1 ns."""
    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0
    """Simulated seconds per wall second in real time."""
    duration_s: Positive = 60.0
    """Length of a lockstep run; a real-time run ends when it is stopped."""
    answer_timeout_s: Positive = 10.0
    """Wall time after which a missing answer to a tick in lockstep is an error."""

    @property
    def tick_ns(self) -> int:
        """The control period [ns]."""
        return round(self.tick_s * 1e9)

    @property
    def ticks(self) -> int:
        """Ticks of a lockstep run."""
        return round(self.duration_s / self.tick_s)


MAX_DT_S = 0.005
"""Largest physics step: with longer steps, wheels at their highest speed would skip a roller.

Up to this step, gains are within 0.5 % of the geometry: `mecazen bench run --only physics`."""


class Pid(Section, frozen=True, kw_only=True):
    """PID from wheel speed to torque, like ROS's effort_controllers/JointVelocityController."""

    p_nms: NonNegative = 2.0
    """Proportional gain [N·m per rad/s]."""
    i_nm: NonNegative = 10.0
    """Integral gain [N·m per rad/s and second]."""
    d_nms2: NonNegative = 0.0
    """Derivative gain [N·m per rad/s²]."""
    i_clamp_nm: NonNegative = 2.0
    """Largest torque of the integral term."""


class PhysicsConfig(Section, frozen=True, kw_only=True):
    """How robots are simulated; their surroundings are in `[world]`.

    Raises:
        ValueError: A combination of settings cannot be simulated.
    """

    dt_s: Annotated[float, msgspec.Meta(ge=1e-5, le=MAX_DT_S)] = MAX_DT_S
    """Length of a physics step; a control period is a whole number of steps."""
    drive: Literal["velocity", "effort"] = "velocity"
    """A commanded wheel speed is held by an ideal servo within the motor's torque
    ("velocity") or by a PID controller in the physics loop ("effort")."""
    motors: Literal["robot", "ideal"] = "robot"
    """robot: motors of the robot file, ideal without a table `motors`; ideal: always ideal."""
    pid: Pid = Pid()
    """Gains of the drive "effort"."""
    watchdog_s: Positive = 0.5
    """Simulated time without a wheel command after which the wheels are stopped. After the same
    time without the person's pose, the person's body stands."""

    def __post_init__(self) -> None:
        if self.watchdog_s < self.dt_s:
            raise ValueError(
                f"physics.watchdog_s = {self.watchdog_s} must not be below "
                f"physics.dt_s = {self.dt_s}"
            )


Key = Annotated[str, msgspec.Meta(pattern=r"^[^/*$?#@\s]+(/[^/*$?#@\s]+)*$")]
"""A key without wildcards, on which samples can be published."""
Name = Annotated[str, msgspec.Meta(min_length=1)]
Diagonal = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
"""Variances of x, y, z [m²] and of roll, pitch, yaw [rad²]; for a twist, the same per s²."""
Limit = Live[Annotated[float, msgspec.Meta(gt=0.0)]]
"""`inf` means no limit."""


class LinearLimits(Section):
    """Limits along x or y of base_link."""

    max_velocity_m_s: Limit = 2.0
    max_acceleration_m_s2: Limit = 2.5
    max_deceleration_m_s2: Live[Limit | None] = None
    """Left out: equal to max_acceleration_m_s2."""
    max_jerk_m_s3: Limit = math.inf
    min_velocity_m_s: Live[Annotated[float, msgspec.Meta(le=0.0)] | None] = None
    """Fastest motion backwards, or to the right; left out: -max_velocity_m_s."""


class AngularLimits(Section):
    """Limits of the yaw rate."""

    max_velocity_rad_s: Limit = 3.0
    max_acceleration_rad_s2: Limit = 8.0
    max_deceleration_rad_s2: Live[Limit | None] = None
    """Left out: equal to max_acceleration_rad_s2."""
    max_jerk_rad_s3: Limit = math.inf
    min_velocity_rad_s: Live[Annotated[float, msgspec.Meta(le=0.0)] | None] = None
    """Fastest turn to the right; left out: -max_velocity_rad_s."""


class AxisLimits(Section):
    """Limits of the commanded twist, in base_link."""

    x: LinearLimits = LinearLimits()
    y: LinearLimits = LinearLimits()
    yaw: AngularLimits = AngularLimits()


class OdometryScale(Section):
    """Calibration of the wheel odometry: ratio of true to nominal motion of each axis."""

    x: Positive = 1.0
    y: Positive = 1.0
    yaw: Positive = 1.0


class OdometryNoise(Section):
    """Standard deviation of white noise in the velocity of the wheel odometry, at each tick.

    The pose integrates it: after a time t, x has the deviation x_m_s·√(t·tick_s).
    """

    x_m_s: NonNegative = 0.0
    y_m_s: NonNegative = 0.0
    yaw_rad_s: NonNegative = 0.0


class Command(Section, omit_defaults=True):
    """A key on which programs command the robot, or a lock; as in ROS's twist_mux."""

    key: Key
    """`cmd_vel` carries commands of programs, not of the scenario's own follower."""
    priority: Annotated[int, msgspec.Meta(ge=1, le=255)] = 100
    """The controller obeys the highest priority among commands that are not stale. The follower has
    priority 0."""
    timeout_s: Positive | None = None
    """Simulated time after which a command is stale; default: reference_timeout_s. A stale lock
    locks; by default it is never stale."""
    lock: bool = False
    """Whether the key has std_msgs/Bool: while true, commands of the same or lower priority are
    ignored."""


class ControllerConfig(Section):
    """The wheel controller."""

    command_key: Key = "cmd_vel"
    """Key of the commanded twist (in base_frame_id), for all publishers and subscribers."""
    commands: tuple[Command, ...] = (Command(key="cmd_vel"),)
    """Sources that may take over from the follower; other keys are not obeyed."""
    reference_timeout_s: Live[Positive] = 0.5
    """Simulated time after which a command is stale and the robot comes to rest."""
    limits: AxisLimits = AxisLimits()
    odometry_key: Key = "odom"
    """Key of the odometry, for all publishers and subscribers."""
    odom_frame_id: Name = "odom"
    base_frame_id: Name = "base_link"
    """Child frame of the odometry. A frame of another name is the parent of base_link in the URDF,
    at the same place: base_link is on the ground, like REP-105's base_footprint."""
    update_rate_hz: Positive | None = None
    """Rate of the odometry; it divides the tick rate. Left out: at every tick."""
    odometry: Literal["wheel", "ground_truth"] = "wheel"
    """Source of the odometry: the wheels' measured angles, or the simulator's truth."""
    half_wheelbase_m: Length | None = None
    """Half the distance between the axles; left out: from the robot file."""
    half_track_m: Length | None = None
    """Half the distance between left and right wheels; left out: from the robot file."""
    wheel_radius_m: WheelRadius | None = None
    """Left out: from the robot file."""
    odometry_scale: OdometryScale = OdometryScale()
    odometry_noise: OdometryNoise = OdometryNoise()
    pose_covariance_diagonal: Diagonal = (1e-3, 1e-3, 0.0, 0.0, 0.0, 1e-2)
    twist_covariance_diagonal: Diagonal = (1e-3, 1e-3, 0.0, 0.0, 0.0, 1e-2)

    def __post_init__(self) -> None:
        if self.odom_frame_id in (self.base_frame_id, "base_link"):
            raise ValueError(
                f"odom_frame_id = {self.odom_frame_id!r} must differ from base_frame_id and from "
                "base_link"
            )
        names = [command.key for command in self.commands]
        if len(set(names)) != len(names):
            raise ValueError("commands: each key at most once")
        if any(command.lock and command.key == "cmd_vel" for command in self.commands):
            raise ValueError("commands: cmd_vel has twists and can't be a lock")


class HardwareConfig(Section):
    """The board of a robot, its port, and when motors are stopped."""

    board: Program = "rosmaster_x3"
    """The kind of board: `rosmaster_x3`, or your own as `file.py:Class`."""
    port: Annotated[str, msgspec.Meta(min_length=1)] = "/dev/ttyUSB0"
    """A serial port."""
    counts_per_turn: Positive | None = None
    """Encoder counts in a turn of a wheel; left out: the value in the firmware."""
    command_timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=0.3)] = 0.2
    """Age of a wheel command above which the robot brakes; with a guard, guard.hold_s applies if it
    is shorter. The motors are stopped at most 0.5 s after the last command."""
    min_voltage_v: NonNegative = 9.9
    """Voltage below which the motors are stopped after 1 s, until a restart."""


Port = Annotated[int, msgspec.Meta(ge=0, le=65535)]


class ViewerConfig(Section):
    """Ports, address and window of the viewer; port 0 selects a free port."""

    web_port: Port = 9090
    data_port: Port = 9876
    """Port of the data, to which the web page and native viewers connect."""
    listen: Annotated[str, msgspec.Meta(min_length=1)] = "127.0.0.1"
    """Address to listen on; 0.0.0.0 in a container, whose host publishes the ports."""
    native: bool = False
    """Whether to open Rerun's own window as well."""

    def __post_init__(self) -> None:
        if self.web_port == self.data_port != 0:
            raise ValueError(f"web_port and data_port must differ: both are {self.web_port}")


class RecorderConfig(Section):
    """File and keys of a recording."""

    file: OutputFile | None = None
    """The MCAP file; left out: `run.mcap` in the working directory. In lockstep it must not exist;
    in real time, where a recorder may be restarted, the next free name is used."""
    keys: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] = ("**",)
    """Zenoh key expressions of the samples to record."""

    @property
    def path(self) -> Path:
        """The file, or its default."""
        return self.file or Path("run.mcap")
