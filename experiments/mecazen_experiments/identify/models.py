"""Kinematic models, from the nominal model of the robot file to a full matrix.

Each model is a matrix J (3, 4) that maps the rotation of the wheels [rad] to the motion of the
robot [m, m, rad]. With radius R, lever l and lateral gain g,

    J = R/4 · [[1, 1, 1, 1], [-g, g, g, -g]/c, [-1, 1, -1, 1]/l],     c = ±cot γ of the rollers.

The ideal kinematics have g = 1; a wheel of N rollers has g = sin(π/N)/(π/N).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from mecazen.robot import WHEELS, Robot

from mecazen_experiments.identify.runs import Array

SIDES = np.array([-1.0, 1.0, 1.0, -1.0])
"""Direction in which each wheel pushes the robot along y."""
TURNS = np.array([-1.0, 1.0, -1.0, 1.0])
"""Direction in which each wheel turns the robot."""
FRAME = ("misalignment_rad", "offset_x_m", "offset_y_m")
"""Mounting of the reference on the robot: its yaw, and its position in base_link."""
ROLLER_COUNTS = range(5, 13)
"""Hypotheses on the number of rollers."""


@dataclass(frozen=True)
class Nominal:
    """The values of the robot file, from which a fit begins."""

    radius: float
    lever: float
    cross_gain: float

    @staticmethod
    def of(robot: Robot) -> Nominal:
        """Return the values of a robot file."""
        return Nominal(robot.wheels.radius_m, robot.lever, robot.cross_gain)

    def matrix(self, radius: float, lever: float, lateral_gain: float = 1.0) -> Array:
        """Return J."""
        rows = np.ones(4), SIDES * lateral_gain / self.cross_gain, TURNS / lever
        return radius / 4.0 * np.stack(rows)


@dataclass(frozen=True)
class Model:
    """A model: the names of its parameters, and the function from parameters to the matrix.

    Each fitted model also has the parameters `FRAME` for each group of runs.
    """

    name: str
    parameters: tuple[str, ...]
    start: tuple[float, ...]
    matrix: Callable[[Array], Array] = field(repr=False)
    """Function from parameters to J (3, 4)."""

    def names(self, groups: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all free parameters."""
        if not self.parameters:
            return ()
        frames = [f"{name} of {group}" if group else name for group in groups for name in FRAME]
        return (*self.parameters, *frames)

    def begin(self, groups: Sequence[str]) -> Array:
        """Return the parameters from which a fit begins."""
        frames = len(self.names(groups)) - len(self.parameters)
        return np.array([*self.start, *(0.0,) * frames])

    def coefficients(self, values: Array, group: int) -> Array:
        """Return J in the reference's frame, and the reference's offset, for a group (14,)."""
        count = len(self.parameters)
        j = self.matrix(values[:count])
        turn, x, y = values[count + 3 * group :][:3] if count else (0.0, 0.0, 0.0)
        c, s = math.cos(turn), math.sin(turn)
        return np.concatenate([c * j[0] + s * j[1], c * j[1] - s * j[0], j[2], [x, y]])


def rollers_gain(count: int) -> float:
    """Return the lateral gain of a wheel of `count` rollers."""
    arc = math.pi / count
    return math.sin(arc) / arc


def nominal(robot: Nominal) -> Model:
    """Return the model of the robot file, without fitted parameters."""
    return Model("nominal", (), (), lambda _: robot.matrix(robot.radius, robot.lever))


def ideal(robot: Nominal) -> Model:
    """Return the ideal kinematics with fitted radius and lever."""
    return _calibrated("ideal, calibrated", robot, 1.0)


def rollers(robot: Nominal, count: int) -> Model:
    """Return the model with the lateral gain of a wheel of `count` rollers."""
    return _calibrated(f"geometry, {count} rollers", robot, rollers_gain(count))


def _calibrated(name: str, robot: Nominal, gain: float) -> Model:
    return Model(
        name,
        ("radius_m", "lever_m"),
        (robot.radius, robot.lever),
        lambda own: robot.matrix(own[0], own[1], gain),
    )


def lateral(robot: Nominal) -> Model:
    """Return the model with a free lateral gain."""
    return Model(
        "lateral gain free",
        ("radius_m", "lever_m", "lateral_gain"),
        (robot.radius, robot.lever, 1.0),
        lambda own: robot.matrix(own[0], own[1], own[2]),
    )


def per_wheel(robot: Nominal) -> Model:
    """Return the model with a separate radius for each wheel."""
    return Model(
        "per wheel",
        ("lever_m", "lateral_gain", *(f"radius of {wheel}_m" for wheel in WHEELS)),
        (robot.lever, 1.0, *[robot.radius] * 4),
        lambda own: robot.matrix(1.0, own[0], own[1]) * own[2:6],
    )


def full(robot: Nominal) -> Model:
    """Return the model with a full matrix.

    The x axis is the direction of motion while all wheels turn alike, so the second row sums to 0.
    Any other direction could not be distinguished from the reference's misalignment.
    """
    begin = robot.matrix(robot.radius, robot.lever).ravel()
    free = [index for index in range(12) if index != 7]
    names = [f"{axis} per {wheel}" for axis in ("x", "y", "yaw") for wheel in WHEELS]

    def matrix(own: Array) -> Array:
        j = np.empty(12)
        j[free] = own
        j[7] = -j[4:7].sum()
        return j.reshape(3, 4)

    return Model("full 3 × 4", tuple(names[index] for index in free), tuple(begin[free]), matrix)


def families(robot: Nominal) -> tuple[Model, ...]:
    """Return the models that an identification compares, by number of parameters."""
    return nominal(robot), ideal(robot), lateral(robot), per_wheel(robot), full(robot)
