"""The search for a lost person, in a flat world of posts: where the robot drives and looks."""

import math

import numpy as np
import pytest
from follower.rooms import BODY, CAMERA, TICK, legs, scan, standing, wall
from mecazen.geometry import Pose2D
from mecazen_follower.search import Search

CORNER = [*wall(-2.0, 3.0, 1.0), *wall(-2.0, 5.0, -1.0)]
CORNER += [(y, x, radius) for x, y, radius in (*wall(-1.0, 6.0, 5.0), *wall(1.0, 6.0, 3.0))]
"""A corridor along x, 2 m wide, that turns to the left at x = 4."""
ROOM = [*wall(-2.0, 2.0, 2.0), *wall(-2.0, 2.0, -2.0)]
ROOM += [(y, x, radius) for x, y, radius in ROOM]
ORIGIN, SPEED_M_S = Pose2D(), 0.8
LAST_SEEN = standing((3.0, 0.0, 0.0), (SPEED_M_S, 0.0))


def search_of(person=LAST_SEEN):
    return Search(person, CAMERA, (BODY.length, BODY.width))


def step(search, circles, robot, strangers=()):
    search.see(scan(robot, circles, beams=720, std=0.01), robot, robot)
    return search.look(robot, strangers)


def drive(search, circles, robot, seconds):
    """Yield each pose and look of a robot that follows each look; it turns at once."""
    for _ in range(round(seconds / TICK)):
        look = step(search, circles, robot)
        yield robot, look
        if look is None:
            return
        way = math.dist(look.way, robot[:2])
        share = min(SPEED_M_S * TICK / max(way, 1e-6), 1.0)
        x, y = (a + share * (b - a) for a, b in zip(robot[:2], look.way, strict=True))
        off = look.place[0] - x, look.place[1] - y
        robot = Pose2D(x, y, math.atan2(off[1], off[0]) if math.hypot(*off) > 0.2 else robot.yaw)


def test_the_robot_goes_round_a_corner_and_looks_at_the_person_behind_it():
    person = (4.0, 4.5)
    posts = [*CORNER, *legs(*person)]
    run = list(drive(search_of(), posts, Pose2D(1.8, 0.3), 10.0))
    gaps = [math.dist(robot[:2], post[:2]) for robot, _ in run for post in CORNER]
    assert min(gaps) > BODY.circle - BODY.person
    seen = [robot for robot, look in run if look and math.dist(look.place, person) < 0.3]
    assert seen
    assert math.dist(seen[-1][:2], person) < CAMERA.max_range


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_opening_on_the_persons_way_comes_first(side):
    posts = [*wall(-2.0, 2.0, side), *wall(3.0, 5.0, side), *wall(-2.0, 2.0, -side)]
    posts += [*wall(3.0, 5.0, -side), *((5.0, y, 0.03) for y in np.arange(-1.0, 1.0, 0.05))]
    walks = standing((2.3, 0.5 * side, 0.0), (0.3, 0.5 * side))
    look = step(search_of(walks), posts, Pose2D(0.8))
    assert look.reason == "an opening"
    assert look.way[0] > 1.2


@pytest.mark.parametrize(
    ("place", "strangers", "looks"),
    [
        ((-1.2, 0.0), (), True),
        ((-1.2, 0.0), [(-1.3, 0.1)], False),  # known to be another person
        ((1.2, 0.0), (), False),  # in the camera's view, and not the person
    ],
)
def test_only_legs_that_may_be_the_person_are_looked_at(place, strangers, looks):
    search = search_of(standing((0.0, 0.0, 0.0)))
    look = step(search, [*ROOM, *legs(*place)], ORIGIN, strangers)
    assert (look is not None) == looks
    if looks:
        assert look.reason == "something like legs"
        assert look.way == pytest.approx(ORIGIN[:2])
        assert math.dist(look.place, place) < 0.2


def test_a_robot_at_a_wall_moves_away_before_it_turns():
    look = step(search_of(), CORNER, Pose2D(2.5, 0.74, 1.5))
    assert look.place == pytest.approx((2.5, 0.74))
