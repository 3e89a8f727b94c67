"""The robot's links: lumped masses, a payload."""

from __future__ import annotations

import numpy as np
import pytest
from mecazen.links import lump, robot_links
from mecazen.robot import Payload
from mecazen_physics import model
from msgspec.structs import replace


def test_a_wheel_and_its_rollers_weigh_the_same_in_parts(robot):
    links, lumped = model.near_tree(robot)
    assert len(links) == 4 + 4 * 2 + 2
    for parts in lumped:
        mass, centre, inertia = lump(parts)
        count = robot.rollers.count - 2
        assert mass == pytest.approx(robot.wheels.hub_mass_kg + count * robot.rollers.mass_kg)
        # the gap is at the bottom, and half a pitch to the side
        assert centre[2] > 0.0
        assert (np.linalg.eigvalsh(inertia) > 0.0).all()


def test_a_load_is_a_link_of_the_description(nexus):
    names = [
        link.name
        for link in robot_links(
            replace(nexus, payload=Payload(mass_kg=2.0, position_m=(0.0, 0.0, 0.3)))
        )
    ]
    assert names[-1] == "payload_link"
