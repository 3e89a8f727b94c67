"""`[physics]`: step, rollers and drive of the simulated robots."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from mecazen.schema import NonNegative, Positive, Section

MAX_DT_S = 0.005
"""Largest physics step: with longer steps, wheels at their highest speed would skip a roller.

Up to this step, gains are within 0.5 % of the geometry and the base does not move up and down:
`mecazen bench run --only steps`."""


class Pid(Section, frozen=True, kw_only=True):
    """Wheel speed to torque, as ROS's effort_controllers/JointVelocityController."""

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
    rollers: Literal["near", "all"] = "near"
    """Which rollers are bodies. "near": those near the ground, while the robot is upright and on a
    plane. "all": always all rollers. Both simulate the same robot; "all" is the reference, at about
    0.7 of the speed of physics with steps of 5 ms, and half of it with steps of 1 ms."""
    drive: Literal["velocity", "effort"] = "velocity"
    """A commanded wheel speed is held by an ideal servo within the motor's torque
    ("velocity") or by a PID controller in the physics loop ("effort")."""
    motors: Literal["robot", "ideal"] = "robot"
    """Motors of the robot file, if it has a table `motors`, or ideal ones in any case."""
    pid: Pid = Pid()
    """Gains of the drive "effort"."""
    watchdog_s: Positive = 0.5
    """Simulated time without a wheel command after which the wheels are stopped; also the time
    without a pose of the person after which the person's body stands."""

    def __post_init__(self) -> None:
        if self.watchdog_s < self.dt_s:
            raise ValueError(
                f"physics.watchdog_s = {self.watchdog_s} must not be below "
                f"physics.dt_s = {self.dt_s}"
            )
