"""Where the target is, seen or unseen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from experiments.followbench.planners.views import view
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.planners.whereabouts import GUESSES, Whereabouts
from mecazen_experiments.followbench.view import Seen

NOW_AND_LATER = np.array([0.0, 2.0])


def test_a_visible_target_walks_straight_on() -> None:
    target = Whereabouts()
    target.update(view(target=Seen(52.0, 50.0, 0.0, 1.0)))
    assert target.ahead(NOW_AND_LATER).tolist() == [[52.0, 50.0], [52.0, 52.0]]
    assert target.heading == pytest.approx(math.pi / 2)


def test_a_zigzag_is_smoothed() -> None:
    target = Whereabouts()
    for k in range(100):
        target.update(view(target=Seen(52.0, 50.0, 1.0, 1.0 if k % 2 else -1.0)))
    x, y = target.ahead(NOW_AND_LATER)[1].tolist()
    # after a second the guess keeps the pace of 1.4 m/s, without the zigzag
    assert x == pytest.approx(52.0 + 1.0 + math.sqrt(2.0), abs=0.05)
    assert y == pytest.approx(50.0, abs=0.2)  # a tenth of 2 m
    assert target.heading == pytest.approx(0.0, abs=0.15)


def test_a_step_aside_does_not_last() -> None:
    target = Whereabouts()
    for _ in range(60):
        target.update(view(target=Seen(52.0, 50.0, 1.0, 0.0)))
    for _ in range(5):
        target.update(view(target=Seen(52.0, 50.0, 0.0, 1.0)))
    x, y = (target.ahead(np.array([6.0]))[0] - (52.0, 50.0)).tolist()
    assert x > 4.5
    assert 0.5 < y < 3.0  # straight on with its velocity, it would be 3.8


def test_an_unseen_target_goes_on_as_before() -> None:
    target = Whereabouts()
    target.update(view(target=Seen(54.8, 50.0, 1.0, 0.0)))
    for _ in range(10):
        target.update(view(target=None))
    assert target.ahead(NOW_AND_LATER)[:, 0] == pytest.approx((55.8, 57.8))


def test_a_target_that_is_not_where_it_should_be_is_sought_elsewhere() -> None:
    target = Whereabouts()
    target.update(view(target=Seen(52.0, 50.0, 1.0, 0.0)))
    target.update(view(target=None))  # the robot sees all within 5 m, and no one there
    assert math.dist(target.ahead(NOW_AND_LATER)[0], (50.0, 50.0)) < 5.0  # all guesses are near ...
    for _ in range(30):
        target.update(view(target=None))
    # ... and once one of them is far enough to be true, it counts
    assert math.dist(target.ahead(NOW_AND_LATER)[0], (50.0, 50.0)) > 4.0


def test_the_robot_comes_to_the_places_of_the_trail_one_after_the_other() -> None:
    target = Whereabouts()
    for k in range(21):
        target.update(view(target=Seen(52.0 + 0.1 * k, 50.0, 1.0, 0.0)))
    assert target.trail[0] == (52.0, 50.0)
    assert target.trail[-1] == pytest.approx((54.0, 50.0), abs=0.3)  # one each 0.3 m
    target.update(view(Pose2D(52.0, 50.5), target=None))
    assert 52.5 < target.trail[0][0] < 53.2
    target.update(view(Pose2D(54.0, 50.0), target=None))
    assert target.trail == []


def test_what_hides_a_guess_keeps_it() -> None:
    target = Whereabouts()
    target.update(view(target=Seen(53.0, 50.0, 0.5, 0.0)))
    wall = (52.0, 50.0, 0.0, 0.2, 8.0)
    target.update(view(target=None, boxes=[wall]))
    assert target.ahead(NOW_AND_LATER)[0] == pytest.approx((53.05, 50.0))


def test_the_first_guess_is_straight_on_and_the_last_one_stands() -> None:
    assert GUESSES[0] == (1.0, 0.0)
    assert GUESSES[-1][0] == 0.0


def test_a_target_that_was_never_visible_is_nowhere() -> None:
    target = Whereabouts()
    target.update(view(Pose2D(), None))
    assert target.last is None
