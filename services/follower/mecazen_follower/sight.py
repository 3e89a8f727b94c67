"""The sensor by which the person is found, and where it sees them."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.config import FollowerConfig, Scenario, SensorConfig
from msgspec.structs import replace

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


def data_sheet(scenario: Scenario) -> SensorConfig:
    """Return rate, latency, field of view and range of the sensor by which the person is found."""
    sensor, lidar, camera = scenario.sensor, scenario.sensors.lidar, scenario.sensors.tracker
    if sensor.kind == "pose":
        return sensor
    if sensor.kind == "legs":
        return replace(
            sensor,
            rate_hz=lidar.rate_hz,
            latency_s=0.0,
            fov_deg=lidar.fov_deg,
            max_range_m=lidar.max_range_m,
        )
    return replace(
        sensor,
        rate_hz=camera.rate_hz,
        latency_s=camera.latency_s,
        fov_deg=camera.horizontal_fov_deg,
        max_range_m=camera.max_range_m,
    )


def field_of(scenario: Scenario, sensor: SensorConfig) -> FieldOfView:
    """Return the field of view of the sensor by which the person is found."""
    camera = scenario.robot.camera if sensor.kind in ("body", "fused") else None
    yaw_deg = 0.0 if camera is None else camera.yaw_deg
    half = math.radians(sensor.fov_deg) / 2.0
    return FieldOfView(half, math.radians(yaw_deg), sensor.max_range_m)


def kept_view(fov: float, centre: float = 0.0) -> FieldOfView:
    """Return the view in which to keep the person, for a field of view `fov` about `centre` [rad].

    The result leaves a margin to the edge of the field of view. The robot turns when the person
    enters this margin.
    """
    return ALL_AROUND if fov >= math.tau else FieldOfView(max(fov / 2 - MARGIN, fov / 4), centre)


def view_of(field: FieldOfView, sensor: SensorConfig, config: FollowerConfig) -> FieldOfView:
    """Return the field of view in which the robot keeps the person, by turning."""
    view = kept_view(2.0 * field.half, field.centre)
    beside = abs(math.sin(config.standoff.bearing)) > BESIDE
    turns = config.planner is not None and config.planner.turns_to_see
    if sensor.kind == "fused" and beside and not turns:
        return view._replace(half=math.pi)
    return view
