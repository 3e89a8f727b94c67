"""Scenarios that physics refuses before a run starts."""

from __future__ import annotations

import msgspec
import pytest
from harness import error_of, load_robot
from mecazen.config import PhysicsConfig, Scenario, WorldConfig
from mecazen.config.world import Box, Cylinder
from mecazen.errors import ConfigError
from mecazen_physics.start import check_obstacles, steps_per_tick

BOX = {"position_m": (-0.3, 0.0), "size_m": (0.2, 0.2, 0.5)}


def check(solid: Box | Cylinder) -> None:
    check_obstacles(Scenario(robot=load_robot(), world=WorldConfig(obstacles=(solid,))), "")


@pytest.mark.parametrize(
    ("solid", "kind"),
    [(Box(**BOX), "box"), (Cylinder(position_m=(-0.3, 0.0), size_m=(0.15, 0.5)), "cylinder")],
)
def test_a_start_inside_an_obstacle_is_refused_and_one_below_it_is_not(solid, kind):
    with pytest.raises(ConfigError, match=rf"start: .* inside the {kind} at \[-0.3, 0\]; move it"):
        check(solid)
    check(Box(**BOX, bottom_m=0.8))


@pytest.mark.parametrize(
    ("dt_s", "nearest"),
    [(0.0019, [0.01 / 6, 0.002]), (0.0049, [0.01 / 3, 0.005]), (0.0007, [0.01 / 15, 0.01 / 14])],
)
def test_a_step_that_does_not_divide_the_tick_is_an_error_that_names_steps_that_do(dt_s, nearest):
    message = error_of(ConfigError, lambda: steps_per_tick(0.01, dt_s))
    begin, _, steps = message.partition("; nearest: ")
    assert begin == f"physics.dt_s = {dt_s} must divide sim.tick_s = 0.01"
    assert list(map(float, steps.split(", "))) == pytest.approx(nearest)
    for step in steps.split(", "):  # as it is printed, it is taken
        steps_per_tick(0.01, float(step))


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
