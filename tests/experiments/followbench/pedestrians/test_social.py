"""Social forces of Follow-Bench against their equations, by hand."""

import math

import pytest
from mecazen_experiments.followbench.pedestrians import social

NO_WALL = (0.0, 0.0, math.inf)
HERE, REST = (0.0, 0.0), (0.0, 0.0)


def test_alone_the_drive_accelerates_towards_the_way_point():
    # 1.5 per second of the missing 1.5 m/s, for a step of 0.1 s
    chosen = social.velocity(HERE, REST, (5.0, 0.0), [], NO_WALL, 0.5, 1.5)
    assert chosen == pytest.approx((0.225, 0.0))


def test_within_its_reach_the_way_point_attracts_no_more():
    assert social.velocity(HERE, REST, (0.7, 0.0), [], NO_WALL, 0.5, 1.5) == (0.0, 0.0)


def test_another_person_at_the_safe_distance_pushes_with_the_full_strength():
    chosen = social.velocity(HERE, REST, (0.5, 0.0), [(0.5, 0.0, 0.0, 0.0)], NO_WALL, 0.5, 1.5)
    assert chosen == pytest.approx((-0.1 * social.PEOPLE_M_S2, 0.0))


def test_a_wall_pushes_away_from_itself():
    wall = (0.0, 1.0, 0.25)  # half of the safe distance: the full strength
    chosen = social.velocity(HERE, REST, (0.5, 0.0), [], wall, 0.5, 1.5)
    assert chosen == pytest.approx((0.0, 0.1 * social.WALL_M_S2))


def test_nobody_is_faster_than_the_maximum():
    crowd = [(0.1, 0.0, 0.0, 0.0)] * 20
    chosen = social.velocity(HERE, REST, (-5.0, 0.0), crowd, NO_WALL, 0.5, 1.5)
    assert math.hypot(*chosen) == pytest.approx(1.5)
