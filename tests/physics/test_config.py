import msgspec
import pytest
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.config.world import Box, Cylinder


def test_obstacles_are_told_apart_by_their_kind():
    raw = [
        {"kind": "box", "size_m": [1.0, 2.0, 0.5], "position_m": [3.0, 0.0], "yaw_deg": 30.0},
        {"kind": "cylinder", "size_m": [0.2, 1.0], "position_m": [0.0, 2.0]},
    ]
    config = msgspec.convert({"obstacles": raw}, WorldConfig)
    assert config.obstacles == (
        Box(size_m=(1.0, 2.0, 0.5), position_m=(3.0, 0.0), yaw_deg=30.0),
        Cylinder(size_m=(0.2, 1.0), position_m=(0.0, 2.0)),
    )


@pytest.mark.parametrize(
    ("kind", "raw", "message"),
    [
        (PhysicsConfig, {"dt_s": 0.0}, "dt_s"),
        (PhysicsConfig, {"dt_s": 0.1}, "dt_s"),
        (PhysicsConfig, {"dt_s": "fast"}, "dt_s"),
        (PhysicsConfig, {"drive": "position"}, "drive"),
        (WorldConfig, {"ground_friction": -1.0}, "ground_friction"),
        (WorldConfig, {"slope_deg": 60.0}, "slope_deg"),
        (PhysicsConfig, {"watchdog_s": 1e-4}, "watchdog_s"),
        (PhysicsConfig, {"detector": "fcl"}, "detector"),
        (PhysicsConfig, {"pid": {"p": 1.0}}, "pid"),
        (WorldConfig, {"person": {"radius_m": 0.0}}, "radius_m"),
        (WorldConfig, {"obstacles": [{"kind": "sphere"}]}, "kind"),
        (
            WorldConfig,
            {"obstacles": [{"kind": "box", "size_m": [1.0], "position_m": [0.0, 0.0]}]},
            "size_m",
        ),
    ],
)
def test_a_wrong_value_is_refused_by_name(kind, raw, message):
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert(raw, kind)
