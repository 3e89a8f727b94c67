"""The social force against its equations, worked out by hand or by differences."""

import math

import numpy as np
import pytest
from mecazen.config.world import Box, Cylinder
from mecazen_people import forces

AHEAD = np.array([[1.0, 0.0]])
HERE = np.zeros((1, 2))


def potential(place, other, velocity):
    """Helbing & Molnár's V(b), of which the force is the gradient."""
    step = np.array(velocity) * forces.STRIDE_S
    apart = np.array(place) - other
    total = math.hypot(*apart) + math.hypot(*(apart - step))
    b = math.sqrt(total**2 - math.hypot(*step) ** 2) / 2.0
    return forces.POTENTIAL_M2_S2 * math.exp(-b / forces.POTENTIAL_M)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (-1.0, 0.2), (0.3, 0.9)])
def test_repulsion_is_the_gradient_of_the_potential(velocity):
    other, step = np.array([0.9, 0.4]), 1e-6
    slope = [
        (potential(-d, other, velocity) - potential(d, other, velocity)) / (2 * step)
        for d in step * np.eye(2)
    ]
    # a body that is touched far away from here adds nothing: e^(-10 / 0.08) of 25 m/s²
    touching = np.array([[-10.0]])
    force = forces.repulsion(HERE, AHEAD, other[None], np.array([velocity]), touching)
    assert force[0, 0] == pytest.approx(slope, rel=1e-6)  # of a central difference


def test_what_is_behind_counts_by_half():
    others, touching = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.full((1, 2), -10.0)
    force = forces.repulsion(HERE, AHEAD, others, np.zeros((2, 2)), touching)[0]
    assert force[0, 0] < 0.0
    assert force[1] == pytest.approx(-forces.BEHIND * force[0])


def test_bodies_that_touch_are_pushed_apart_by_more_than_the_drive():
    touching = np.array([[0.4]])
    force = forces.repulsion(HERE, AHEAD, np.array([[0.4, 0.0]]), np.zeros((1, 2)), touching)
    assert force[0, 0, 0] < -forces.CONTACT_M_S2


def test_nobody_repels_themselves():
    touching = np.array([[math.inf]])
    assert not forces.repulsion(HERE, AHEAD, HERE, np.zeros((1, 2)), touching).any()


@pytest.mark.parametrize(
    ("thing", "place", "away", "distance"),
    [
        (Cylinder(size_m=(0.5, 2.0), position_m=(1.0, 0.0)), (0.0, 0.0), (-1.0, 0.0), 0.5),
        (Box(size_m=(2.0, 1.0, 1.0), position_m=(0.0, 0.0)), (0.3, 1.5), (0.0, 1.0), 1.0),
        (Box(size_m=(2.0, 2.0, 1.0), position_m=(0.0, 0.0)), (4.0, 5.0), (0.6, 0.8), 5.0),
        (
            Box(size_m=(2.0, 1.0, 1.0), position_m=(0.0, 0.0), yaw_deg=90.0),
            (1.5, 0.0),
            (1.0, 0.0),
            1.0,
        ),
        (Box(size_m=(2.0, 1.0, 1.0), position_m=(0.0, 0.0)), (0.0, 0.4), (0.0, 1.0), -0.1),
    ],
)
def test_the_nearest_point_of_an_obstacle(thing, place, away, distance):
    way, gap = forces.nearest(np.array([place]), thing)
    assert way[0] == pytest.approx(away)
    assert gap[0] == pytest.approx(distance)


def test_an_obstacle_repels_by_its_potential():
    wall = Box(size_m=(10.0, 1.0, 2.0), position_m=(0.0, 1.5))
    force = forces.from_obstacles(HERE, [wall])
    assert force[0] == pytest.approx((0.0, -50.0 * math.exp(-1.0 / 0.2)))
