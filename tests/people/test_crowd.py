"""Pedestrians who give way: their goals, their distances, and the forces between them."""

import math
from itertools import combinations

import numpy as np
import pytest
from mecazen.config.people import Reactive
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen_people import forces
from mecazen_people.crowd import CLEAR_M, Agent, Errand, Pedestrians, random_errands

RADIUS_M, DT_S = 0.2, 0.02
AREA = Reactive(count=12, x_m=(-4.0, 4.0), y_m=(-3.0, 3.0))


def walk(errands, seconds, others=lambda t: (), obstacles=()):
    """Return the places of all at each step."""
    crowd = Pedestrians(errands, obstacles, RADIUS_M, 7)
    places = []
    for step in range(1, round(seconds / DT_S) + 1):
        crowd.step(step * DT_S, DT_S, others(step * DT_S))
        places.append([motion.pose for motion in crowd.motions])
    return places


def test_pedestrian_avoids_standing_and_moving_robots():
    errand = Errand(Pose2D(), ((8.0, 0.0),), False, 1.3)
    for speed in (0.0, -0.5):

        def robot(t, speed=speed):
            return (Agent(4.0 + speed * t, 0.05, speed, 0.0, 0.45),)

        places = walk([errand], 10.0, robot)
        gaps = [
            math.hypot(one.x - 4.0 - speed * DT_S * n, one.y - 0.05)
            for n, (one,) in enumerate(places, 1)
        ]
        assert min(gaps) > 0.45 + RADIUS_M
        assert places[-1][0].x > 7.0


def test_crowd_keeps_clear_of_walls_and_neighbours():
    wall = Box(size_m=(1.0, 0.2, 2.0), position_m=(0.0, 0.0))
    places = walk(random_errands(AREA, 3, (), [wall]), 20.0, obstacles=[wall])
    for now in places:
        for one in now:
            over = (abs(one.x) - 0.5, abs(one.y) - 0.1)
            assert math.hypot(*(max(part, 0.0) for part in over)) > RADIUS_M
    near = min(a.distance(b) for now in places for a, b in combinations(now, 2))
    # twelve on 48 m² squeeze past each other: shoulders, not trunks
    assert near > 1.5 * RADIUS_M


def test_random_starts_are_clear_and_repeatable():
    errands = random_errands(AREA, 3, [(0.0, 0.0)], ())
    starts = [Pose2D(), *(one.start for one in errands)]
    assert all(a.distance(b) >= CLEAR_M for a, b in combinations(starts, 2))
    assert errands == random_errands(AREA, 3, [(0.0, 0.0)], ())
    assert errands != random_errands(AREA, 4, [(0.0, 0.0)], ())
    speeds = [one.speed for one in errands]
    assert all(0.3 <= speed <= 1.34 + 4 * 0.26 for speed in speeds)


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


@pytest.mark.parametrize(
    ("thing", "place", "away", "distance"),
    [
        (Cylinder(size_m=(0.5, 2.0), position_m=(1.0, 0.0)), (0.0, 0.0), (-1.0, 0.0), 0.5),
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
    way, gap = forces.nearest(np.array([place]), forces.shapes_of([thing]))
    assert way[0] == pytest.approx(away)
    assert gap[0] == pytest.approx(distance)
