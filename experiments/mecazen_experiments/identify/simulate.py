"""The full simulation driven by recorded wheel speeds."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
from mecazen.config import PhysicsConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.robot import RealMotors, Robot
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation

from mecazen_experiments.identify.data import Array, Run
from mecazen_experiments.identify.identification import Identification
from mecazen_experiments.identify.motors import identified_motors
from mecazen_experiments.identify.windows import TURNS

ROLLER_SHARE = 0.3
"""Maximum rotation of a wheel in a step at its highest speed, as a share of the roller pitch."""
TURNED_S, TURN_S = 60.0, 0.5
"""Duration of the part of a run whose yaw is compared with the simulation, and length of its
parts."""


def simulated(robot: Robot, run: Run) -> Array:
    """Return the poses of base_link (n, 3) from a simulation with the wheel speeds of a run."""
    pitch = 2.0 * math.pi / robot.rollers.count
    longest = min(PhysicsConfig().dt_s, ROLLER_SHARE * pitch / robot.wheels.max_speed_rad_s)
    steps = math.ceil(run.period_s / longest - 1e-6)
    physics = PhysicsConfig(dt_s=round(run.period_s / steps, 9))
    simulation = Simulation([(robot, Pose2D())], physics)
    speeds = np.diff(run.wheels, axis=0) / run.period_s
    poses = np.zeros((len(run.times), 3))
    for index, command in enumerate(speeds.tolist(), 1):
        simulation.advance([WheelCommand(command)], steps)
        state = simulation.robots[0].state
        poses[index] = *state.position[:2], state.yaw
    poses[:, 2] = np.unwrap(poses[:, 2])
    return poses


def identified_robot(robot: Robot, result: Identification, run: Run) -> Robot:
    """Return the robot file with the identified radius, lever, number of rollers, and motors.

    Wheelbase and track are scaled by the same factor. Since contacts move along the axles, a robot
    turns by another angle than the ideal kinematics of its file. So the scale is chosen such that
    the simulation of a run turns as far as the identified kinematics.

    Raises:
        ConfigError: Such a robot can't be simulated.
    """
    radius, lever = (result.geometry.by_name[name] for name in ("radius_m", "lever_m"))

    def scaled(scale: float) -> Robot:
        wheels = msgspec.structs.replace(
            robot.wheels,
            radius_m=round(radius, 6),
            wheelbase_m=round(robot.wheels.wheelbase_m * scale, 6),
            track_m=round(robot.wheels.track_m * scale, 6),
        )
        rollers = msgspec.structs.replace(robot.rollers, count=result.rollers)
        try:
            return msgspec.structs.replace(robot, wheels=wheels, rollers=rollers)
        except ValueError as error:
            raise ConfigError(f"the identified robot: {error}") from None

    end = round(TURNED_S / run.period_s)
    short = replace(run, times=run.times[:end], poses=run.poses[:end], wheels=run.wheels[:end])
    size = max(1, round(TURN_S / run.period_s))
    ideal = np.diff((short.wheels @ TURNS)[::size]) * radius / 4.0 / lever
    turned = np.diff(simulated(scaled(lever / robot.lever), short)[::size, 2])
    gain = float(turned @ ideal / (ideal @ ideal))
    changed = scaled(gain * lever / robot.lever)
    if result.motors:
        motors = identified_motors(robot.motors or RealMotors(), result.motors)
        changed = msgspec.structs.replace(changed, motors=motors)
    return changed
