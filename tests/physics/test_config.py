from __future__ import annotations

from typing import Any

import msgspec
import pytest
from mecazen_physics.config import Box, Cylinder, PhysicsConfig


def test_defaults_need_nothing() -> None:
    assert msgspec.convert({}, PhysicsConfig) == PhysicsConfig()


def test_obstacles_are_told_apart_by_their_kind() -> None:
    raw = [
        {"kind": "box", "size_m": [1.0, 2.0, 0.5], "position_m": [3.0, 0.0], "yaw_deg": 30.0},
        {"kind": "cylinder", "size_m": [0.2, 1.0], "position_m": [0.0, 2.0]},
    ]
    config = msgspec.convert({"obstacles": raw}, PhysicsConfig)
    assert config.obstacles == (
        Box(size_m=(1.0, 2.0, 0.5), position_m=(3.0, 0.0), yaw_deg=30.0),
        Cylinder(size_m=(0.2, 1.0), position_m=(0.0, 2.0)),
    )


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ({"dt_s": 0.0}, "dt_s"),
        ({"dt_s": 0.1}, "dt_s"),
        ({"dt_s": "fast"}, "dt_s"),
        ({"roller_spheres": 10}, "must be odd"),
        ({"drive": "position"}, "drive"),
        ({"rollers": "some"}, "rollers"),
        ({"ground_friction": -1.0}, "ground_friction"),
        ({"slope_deg": 60.0}, "slope_deg"),
        ({"watchdog_s": 1e-4}, "watchdog_s"),
        ({"detector": "fcl"}, "detector"),
        ({"pid": {"p": 1.0}}, "pid"),
        ({"person": {"radius_m": 0.0}}, "radius_m"),
        ({"obstacles": [{"kind": "sphere"}]}, "kind"),
        ({"obstacles": [{"kind": "box", "size_m": [1.0], "position_m": [0.0, 0.0]}]}, "size_m"),
    ],
)
def test_a_wrong_value_is_refused_by_name(raw: dict[str, Any], message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert(raw, PhysicsConfig)
