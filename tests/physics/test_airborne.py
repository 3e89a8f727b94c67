"""Rollers in the air turn freely but for their bearings' friction."""

from __future__ import annotations

import math

import pytest
from mecazen.rollers import Roller
from mecazen_physics.state import BASE_DOFS
from msgspec.structs import replace
from physics_rig import Rig


def test_an_airborne_roller_keeps_its_spin_but_for_its_bearings_friction(nexus):
    friction = 2e-5
    robot = replace(nexus, rollers=replace(nexus.rollers, bearing_friction_nms=friction))
    rig = Rig(robot)
    fifth = BASE_DOFS + 4 + 4  # of the front left wheel, near the top
    rig.body.skeleton.setVelocity(fifth, 10.0)
    state = rig.advance([0.0] * 4, 100)
    decay = friction / Roller.from_robot(robot).inertia[1]
    # 6 %: DART's implicit steps of 1 ms, of a time constant of 30 ms, three times over.
    expected = 10.0 * math.exp(-0.1 * decay)
    assert state.joint_velocity[4 + 4] == pytest.approx(expected, rel=0.06)
    turned = 10.0 * (1.0 - math.exp(-0.1 * decay)) / decay
    assert state.joint_position[4 + 4] == pytest.approx(turned, rel=0.02)
