"""`make pictures` makes exactly the pictures that documents say it makes."""

import re

import numpy as np
import pytest
from harness import ROOT
from mecazen.links import base_link, robot_links
from mecazen.loading import load_scenario, scenario_path
from mecazen.wheels import WheelCommand
from mecazen_physics.world import GRAVITY

from docs.pictures import rollers
from docs.pictures.__main__ import DOCS, PICTURES

MADE = re.compile(r"<!-- by hand: drawn by make pictures -->\n((?:.*!\[[^\]]*\]\([^)]*\).*\n)+)")
"""The comment, and the lines with pictures below it."""
SHOWN = re.compile(r"!\[([^\]]*)\]\(([^)]*)\)")


def shown():
    """Return the files and alternative texts of all pictures that documents say are made."""
    for document in (ROOT / "README.md", *sorted(DOCS.glob("*.md"))):
        for lines in MADE.findall(document.read_text()):
            for text, place in SHOWN.findall(lines):
                yield (document.parent / place).resolve(), text


def test_every_picture_that_a_document_shows_is_made_and_every_one_made_is_shown():
    made = {DOCS / place for place in PICTURES}
    assert {file for file, _ in shown()} == made
    assert all(file.exists() for file in made)
    assert all(text for _, text in shown())


def test_forces_of_the_ground_carry_the_robot_and_push_it_to_its_left():
    robot = load_scenario(scenario_path("back")).robot
    simulation = rollers.accelerated(robot)
    command = WheelCommand(rollers.TORQUES_NM, is_effort=True)
    weights = []
    for _ in range(60):
        simulation.advance([command], 1)
        forces = rollers.contacts(simulation)
        weights.append(sum(force.normal[2] for force in forces))
    mass = sum(link.mass for link in (base_link(robot), *robot_links(robot)))
    # single steps differ by 10 % as rollers come and go; in 0.3 s at 1 cm/s their mean by 0.4 %
    assert np.mean(weights) == pytest.approx(GRAVITY * mass, rel=0.005)
    ahead, left, _ = sum(force.friction for force in forces)
    assert left > 10.0 * abs(ahead)
    for _, _, friction in forces:  # rollers at 45° that are tilted by up to 20°: cos 20° = 0.94
        assert abs(friction[0]) == pytest.approx(abs(friction[1]), rel=0.07)
