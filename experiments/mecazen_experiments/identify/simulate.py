"""The full simulation driven by recorded wheel speeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import repeat

import msgspec
import numpy as np
from mecazen.config import PhysicsConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.robot import Robot
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation

from mecazen_experiments.identify.data import Array, Run
from mecazen_experiments.identify.windows import TURNS, shifted
from mecazen_experiments.runs import CORES, processes
from mecazen_experiments.statistics import Interval

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


def all_simulated(robot: Robot, runs: Sequence[Run]) -> list[Array]:
    """Return the poses of each run, simulated on all cores."""
    with processes(min(CORES, len(runs))) as pool:
        return list(pool.map(simulated, repeat(robot), runs))


def mounted(poses: Array, mounting: Array) -> Array:
    """Convert poses of base_link to poses of the reference.

    Args:
        poses: Poses of base_link (n, 3).
        mounting: Misalignment [rad] and offset [m] of the reference (3,).
    """
    return shifted(poses + np.array([0.0, 0.0, mounting[0]]), mounting[1:])


def identified_robot(
    robot: Robot, parameters: Mapping[str, Interval], count: int, run: Run
) -> Robot:
    """Return the robot file with the identified radius, lever and number of rollers.

    Wheelbase and track are scaled by the same factor. Since contacts move along the axles, a robot
    turns by another angle than the ideal kinematics of its file. So the scale is
    chosen such that the simulation of a run turns as far as the identified kinematics.

    Raises:
        ConfigError: Such a robot can't be simulated.
    """
    radius, lever = (parameters[name].mean for name in ("radius_m", "lever_m"))
    unscaled = _scaled(robot, radius, lever / robot.lever, count)
    end = round(TURNED_S / run.period_s)
    short = replace(run, times=run.times[:end], poses=run.poses[:end], wheels=run.wheels[:end])
    size = max(1, round(TURN_S / run.period_s))
    ideal = np.diff((short.wheels @ TURNS)[::size]) * radius / 4.0 / lever
    turned = np.diff(simulated(unscaled, short)[::size, 2])
    gain = float(turned @ ideal / (ideal @ ideal))
    return _scaled(robot, radius, gain * lever / robot.lever, count)


def _scaled(robot: Robot, radius: float, scale: float, count: int) -> Robot:
    wheels = robot.wheels
    try:
        return msgspec.structs.replace(
            robot,
            wheels=msgspec.structs.replace(
                wheels,
                radius_m=round(radius, 6),
                wheelbase_m=round(wheels.wheelbase_m * scale, 6),
                track_m=round(wheels.track_m * scale, 6),
            ),
            rollers=msgspec.structs.replace(robot.rollers, count=count),
        )
    except ValueError as error:
        raise ConfigError(f"the identified robot: {error}") from None
