"""Engines on the same manoeuvres: energy, gains and Coulomb's law, against hand calculations."""

import math

import pytest
from bench.ideal import STEP_S, Ideal
from mecazen_bench import physics
from mecazen_bench.engine import PlanarInertia, Sample, measure_accuracy, measure_slide, slippery
from mecazen_bench.stack import robot


def test_a_body_has_the_energy_of_its_motion():
    body = PlanarInertia(mass=2.0, yaw_inertia=0.5, wheel_inertia=0.01)
    before = Sample(0.0, 0.0, 0.0, 3.1, (0.0, 0.0, 0.0, 0.0))
    # 1 m/s, 0.2 rad/s through ±π, and 10, 10, 0, -10 rad/s, over 0.5 s
    after = Sample(0.3, 0.4, 0.0, 3.2 - 2.0 * math.pi, (5.0, 5.0, 0.0, -5.0))
    expected = 0.5 * 2.0 * 1.0 + 0.5 * 0.5 * 0.2**2 + 0.5 * 0.01 * 300.0
    # rounding of the difference of two angles
    assert body.energy(before, after, 0.5) == pytest.approx(expected, rel=1e-12)


def test_a_robot_has_the_mass_and_the_inertia_of_its_parts():
    nexus = robot("nexus")
    body = PlanarInertia.of(nexus)
    parts = nexus.base.mass_kg + nexus.camera.mass_kg + nexus.lidar.mass_kg
    wheel = nexus.wheels.hub_mass_kg + nexus.rollers.count * nexus.rollers.mass_kg
    assert body.mass == pytest.approx(parts + 4 * wheel)
    # the hub as a solid cylinder, the rollers between points at their distance and at the rim
    radius, thick = nexus.wheels.radius_m, nexus.rollers.max_radius_m
    hub = nexus.wheels.hub_mass_kg * (radius - 2 * thick) ** 2 / 2
    rollers = nexus.rollers.count * nexus.rollers.mass_kg
    assert hub + rollers * (radius - thick) ** 2 < body.wheel_inertia < hub + rollers * radius**2
    # wheels as points, and the base as a box, are most of what turns with the robot
    points = 4 * wheel * (nexus.half_wheelbase**2 + nexus.half_track**2)
    box = nexus.base.mass_kg * (nexus.base.length_m**2 + nexus.base.width_m**2) / 12
    assert points + box < body.yaw_inertia < 1.1 * (points + box)


@pytest.mark.parametrize("slowing", [0.0, 0.1])
def test_an_ideal_robot_has_gains_of_one_and_loses_what_slows_it(slowing):
    found = measure_accuracy(Ideal(slowing))
    # sums of thousands of steps
    assert found[1:4] == pytest.approx((1.0, 1.0, 1.0), rel=1e-9)
    assert found.ripple == 0.0
    # v² falls by twice its rate, from the middle of one passage to that of another 1 s later
    assert found.energy == pytest.approx(math.exp(-2.0 * slowing) - 1.0, abs=1e-4)


def test_with_locked_wheels_our_robot_slows_down_as_coulomb_says_at_every_yaw():
    engine = physics.DartEngine(slippery(robot("nexus")), STEP_S)
    slides = measure_slide(engine)
    assert list(slides) == [0.0, 22.5, 45.0]
    # where left and right wheels stand on rollers at other angles, it is pushed aside a little
    assert list(slides.values()) == pytest.approx([1.0] * 3, abs=0.015)
