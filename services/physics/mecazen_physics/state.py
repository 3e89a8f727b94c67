"""The state of a robot, from DART's coordinates to those of ROS."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.errors import MecazenError
from mecazen.geometry import rotate
from mecazen.robot import WHEELS

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


BASE_DOFS = 7
"""Degrees of freedom of the base in space and of its front axle, before those of the joints: a
rotation vector [rad], base_link's origin [m] and the axle's angle [rad] in axes of the world."""


class DivergedError(MecazenError):
    """The simulated state is no longer plausible."""


class RobotState(NamedTuple):
    """A robot at one instant.

    `position` (3,) [m] and `orientation`, a quaternion (x, y, z, w), place base_link in the
    world frame. `linear` (3,) [m/s] and `angular` (3,) [rad/s] are the velocity of
    base_link's origin relative to the world, in the axes of base_link. The joints' lists are in the
    order of `SimulatedRobot.joint_names`: positions [rad], not wrapped, velocities [rad/s], and
    efforts [N·m]. An effort is the torque of a wheel's motor in the last step, or the bearing's
    friction on a roller.
    """

    time: float
    position: Vector
    orientation: Quaternion
    linear: Vector
    angular: Vector
    joint_position: list[float]
    joint_velocity: list[float]
    joint_effort: list[float]

    @property
    def tilt(self) -> float:
        """Angle between base_link's z axis and that of the world [rad]."""
        return 2.0 * math.asin(min(1.0, math.hypot(*self.orientation[:2])))

    @property
    def yaw(self) -> float:
        """Heading in the world frame [rad], of a robot that hardly leans."""
        return 2.0 * math.atan2(*self.orientation[2:])


def check_converged(state: RobotState, before: RobotState, depth: float, speed: float) -> None:
    """Refuse a state that a robot on the ground cannot reach from that `before`.

    The base_link may be at most `depth` [m] below the ground and have at most `speed` [m/s]. The
    speed is checked since DART moves a body whose pose is NaN to the origin.

    Raises:
        DivergedError: The state is not plausible; the message contains the last good state.
    """
    everything = sum(state.joint_position) + sum(state.joint_velocity)
    everything += sum(state.position) + sum(state.linear) + sum(state.angular)
    moved = math.dist(state.position, before.position)
    duration = state.time - before.time
    if not math.isfinite(everything):
        reason = "its numbers are not finite"
    elif state.position[2] < -depth:
        reason = f"the robot is {-state.position[2]:.3g} m below the ground"
    elif moved > speed * duration:
        reason = f"the robot moved {moved:.3g} m in {duration:.3g} s"
    else:
        return
    raise DivergedError(
        f"physics diverged before {state.time:.3f} s: {reason}; last good state at "
        f"{before.time:.3f} s: position {before.position} m, orientation "
        f"{before.orientation}, velocity {before.linear} m/s, {before.angular} rad/s, "
        f"wheels {before.joint_velocity[: len(WHEELS)]} rad/s"
    )


def in_axes_at(
    position: list[float], velocity: list[float], angle: float
) -> tuple[list[float], list[float]]:
    """Return a free joint's positions and velocities (6,) in axes that are turned by -`angle`."""
    x, y, z, w = turned(quaternion(*position[:3]), angle)
    sine, sign = math.hypot(x, y, z), math.copysign(1.0, w)
    scale = sign * (2.0 * math.atan2(sine, sign * w) / sine if sine > 0.0 else 2.0)
    rotation = scale * x, scale * y, scale * z  # of at most π
    place = rotate(position[3], position[4], angle)
    spin, speed = rotate(velocity[0], velocity[1], angle), rotate(velocity[3], velocity[4], angle)
    return [*rotation, *place, position[5]], [*spin, velocity[2], *speed, velocity[5]]


def quaternion(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion (x, y, z, w) of a rotation vector [rad]."""
    angle = math.hypot(x, y, z)
    scale = math.sin(angle / 2) / angle if angle > 0.0 else 0.5
    return scale * x, scale * y, scale * z, math.cos(angle / 2)


def turned(q: Quaternion, angle: float) -> Quaternion:
    """Return the orientation after a turn by `angle` about the vertical [rad]."""
    c, s = math.cos(angle / 2.0), math.sin(angle / 2.0)
    x, y, z, w = q
    return c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z


def unrotate(q: Quaternion, x: float, y: float, z: float) -> Vector:
    """Return the components of the vector (x, y, z) in the frame that is rotated by `q`."""
    qx, qy, qz, w = q
    # v + 2·p×(p×v + w·v) for the inverse rotation: its quaternion is (p, w), p = -(qx, qy, qz).
    cx = qz * y - qy * z + w * x
    cy = qx * z - qz * x + w * y
    cz = qy * x - qx * y + w * z
    return (
        x + 2.0 * (qz * cy - qy * cz),
        y + 2.0 * (qx * cz - qz * cx),
        z + 2.0 * (qy * cx - qx * cy),
    )
