"""Shapes of things in the scene."""

import numpy as np
import pytest
from harness import SCENARIOS, load_robot
from mecazen.config import Scenario, WorldConfig
from mecazen.config.world import Patch, Ramp
from mecazen.loading import load_scenario
from mecazen_viewer import entities as e
from mecazen_viewer.health import Health
from mecazen_viewer.picture import Picture, surroundings


def test_a_ramp_stands_with_its_top_at_its_height_and_a_patch_is_outlined():
    ramp = Ramp(length_m=1.0, width_m=0.8, rise_m=0.08, position_m=(3.0, 0.0), heading_deg=90.0)
    patch = Patch(size_m=(2.0, 1.0), position_m=(1.0, 1.0), friction=0.3)
    world = WorldConfig(ramps=(ramp,), patches=(patch,))
    shown = dict(surroundings(Scenario(robot=load_robot(), world=world)))
    corners = np.array(shown[f"{e.RIDGES}/0"].vertex_positions.as_arrow_array().to_pylist())
    assert corners.min(axis=0) == pytest.approx((2.6, -1.5, 0.0), abs=1e-6)
    assert corners.max(axis=0) == pytest.approx((3.4, 1.5, 0.08), abs=1e-6)
    assert f"{e.PATCHES}/0" in shown
    assert f"{e.OBSTACLES}/1" in shown  # its rails


def test_a_crowd_and_what_a_camera_sees_are_in_the_scene_where_the_scenario_has_them():
    crowd, back = (load_scenario(SCENARIOS / f"{name}.toml") for name in ("crowd", "back"))
    found = [
        {path for path, _ in (*surroundings(one), *Picture(one, Health()).shapes())}
        for one in (crowd, back)
    ]
    assert found[0] - found[1] >= {e.PEOPLE, e.FRUSTUM}
    assert not found[1] & {e.PEOPLE, e.FRUSTUM}
