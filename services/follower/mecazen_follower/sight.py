"""The sensor by which the person is found, and where it sees them."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.config import FollowerConfig, Scenario

MARGIN = math.radians(15.0)
"""Angle between the kept view of the person and the edge of the field of view [rad]."""
BESIDE = math.sin(math.radians(60.0))
"""Sine of the bearing beyond which the robot is beside the person. If the robot turns away from its
heading there, its wheels are too slow to return. So the robot does not turn to keep the person in
the camera's view and relies on the lidar, unless the planner gives up the heading first."""


class FieldOfView(NamedTuple):
    """Directions within `half` of the direction `centre` in base_link [rad], up to a range [m]."""

    half: float = math.inf
    centre: float = 0.0
    max_range: float = math.inf


ALL_AROUND = FieldOfView()


class Sight(NamedTuple):
    """The sensor by which the person is found."""

    kind: str
    rate_hz: float
    latency_s: float
    field: FieldOfView


def sight_of(scenario: Scenario) -> Sight:
    """Return the sensor of a scenario by which the person is found."""
    sensor, lidar, camera = scenario.sensor, scenario.sensors.lidar, scenario.sensors.tracker
    rate_hz, latency_s, yaw_deg = sensor.rate_hz, sensor.latency_s, 0.0
    fov_deg, max_range_m = sensor.fov_deg, sensor.max_range_m
    if sensor.kind == "legs":
        rate_hz, latency_s = lidar.rate_hz, 0.0
        fov_deg, max_range_m = lidar.fov_deg, lidar.max_range_m
    elif sensor.kind != "pose":
        rate_hz, latency_s = camera.rate_hz, camera.latency_s
        fov_deg, max_range_m = camera.horizontal_fov_deg, camera.max_range_m
        yaw_deg = 0.0 if scenario.robot.camera is None else scenario.robot.camera.yaw_deg
    field = FieldOfView(math.radians(fov_deg) / 2.0, math.radians(yaw_deg), max_range_m)
    return Sight(sensor.kind, rate_hz, latency_s, field)


def view_of(sight: Sight, config: FollowerConfig) -> FieldOfView:
    """Return the field of view in which the robot keeps the person, by turning.

    It leaves a margin to the edge of the sensor's. The robot turns when the person enters the
    margin.
    """
    half, centre, _ = sight.field
    if half >= math.pi:
        return ALL_AROUND
    beside = abs(math.sin(config.standoff.bearing)) > BESIDE
    turns = config.planner is not None and config.planner.turns_to_see
    if sight.kind == "fused" and beside and not turns:
        return FieldOfView(math.pi, centre)
    return FieldOfView(max(half - MARGIN, half / 2.0), centre)
