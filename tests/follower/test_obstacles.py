"""The surroundings of the robot, by scans of a flat world."""

import numpy as np
import pytest
from follower.rooms import legs, scan, wall
from mecazen.geometry import Pose2D
from mecazen_follower.planner.obstacles import MEMORY_S, Surroundings

ORIGIN = Pose2D()


def test_the_persons_legs_are_no_obstacle_and_a_pillar_is():
    around = Surroundings()
    person = Pose2D(1.5, 0.0)
    around.see(0.0, scan(ORIGIN, [*legs(1.5, 0.0), (1.0, 1.5, 0.15)]), ORIGIN, person)
    points = around.standing(ORIGIN)
    assert len(points) >= 2
    assert np.hypot(*(points - (1.0, 1.5)).T) == pytest.approx(0.15, abs=1e-3)
    # so near a wall is not taken for a leg
    around.see(0.1, scan(ORIGIN, wall(0.5, 2.5, 0.3)), ORIGIN, person)
    assert len(around.standing(ORIGIN)) > 10  # of 2 m, a point each 10 cm; aslant less


def test_what_is_hidden_is_remembered_for_a_while_and_what_is_gone_is_not():
    pillar, other = (2.0, 0.0, 0.1), (0.0, 2.0, 0.1)
    nobody = Pose2D(-5.0, 0.0)
    around = Surroundings()
    around.see(0.0, scan(ORIGIN, [pillar, other]), ORIGIN, nobody)

    def near(place):
        gaps = np.hypot(*(around.standing(ORIGIN) - place[:2]).T)
        return bool((gaps < 0.15).any())

    hides = (1.0, 0.0, 0.2)
    around.see(0.1, scan(ORIGIN, [hides]), ORIGIN, nobody)
    assert near(pillar)
    assert not near(other)
    around.see(MEMORY_S + 0.1, scan(ORIGIN, [hides]), ORIGIN, nobody)
    assert not near(pillar)
