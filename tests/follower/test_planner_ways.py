"""The planner in closed loop, in a flat world: what it does about what is in the way."""

import math

import pytest
from follower.rooms import BODY, follow, wall
from mecazen.geometry import wrap
from mecazen.standoff import Standoff

SIDE = {"view": "side_left", "standoff_m": 1.2}
PLACE = Standoff(1.2, math.pi / 2, -math.pi / 2)
NARROWEST = min(BODY.length, BODY.width)
"""From the middle of the robot to its nearest side [m]."""


def bearings(way):
    """Return the robot's bearing less that of its place, at each tick [deg]."""
    return [math.degrees(PLACE.errors(person, robot).bearing) for robot, person, *_ in way]


def test_a_pillar_in_the_way_is_passed_and_the_side_is_regained():
    way = list(follow(10.0, [(3.0, 1.2, 0.15)], **SIDE))
    assert min(gap for *_, gap in way) > NARROWEST + 0.05  # of the 0.12 m: cells of 6 cm
    assert {state for _, _, state, _ in way} >= {"open", "avoiding"}
    assert way[-1][2] == "open"
    assert bearings(way)[-1] == pytest.approx(0.0, abs=2.0)  # the law's own way back
    assert all(abs(robot.distance(person) - 1.2) < 0.3 for robot, person, *_ in way)


def test_where_the_side_is_blocked_it_goes_behind_and_comes_back_by_itself():
    corridor = wall(3.0, 6.0, 0.85) + wall(3.0, 6.0, -0.85)
    way = list(follow(14.0, corridor, **SIDE))
    off = bearings(way)
    within = [off[k] for k, (robot, *_) in enumerate(way) if 3.5 < robot.x < 5.5]
    assert within
    assert min(within) > 45.0  # nearer to behind, 90 degrees away, than to the side
    assert "gave_up_bearing" in {state for _, _, state, _ in way}
    assert way[-1][2] == "open"
    assert off[-1] == pytest.approx(0.0, abs=2.0)
    assert min(gap for *_, gap in way) > NARROWEST + 0.05
    for robot, person, *_ in way:  # in view all the time
        seen = math.atan2(person.y - robot.y, person.x - robot.x)
        assert abs(math.degrees(wrap(seen - robot.yaw))) < 37.5


def test_before_a_gap_that_is_too_narrow_it_waits():
    room = [(3.0, sign * (0.22 + 0.05 * k), 0.03) for k in range(60) for sign in (1, -1)]
    *_, (robot, person, state, _) = way = list(follow(11.0, room, **SIDE))
    assert state == "waiting"
    assert robot.x < 3.0 < person.x
    assert min(gap for *_, gap in way) > NARROWEST


def test_somebody_who_comes_across_is_let_pass():
    # they would meet the robot beside its person at 3 s
    way = list(follow(7.0, [], walkers=[(1.8, 4.2, 0.0, -0.8)], view="back", standoff_m=1.2))
    straight = list(follow(7.0, [], view="back", standoff_m=1.2))
    met = min(math.dist(r[:2], (1.8, 4.2 - 0.8 * 0.05 * k)) for k, (r, *_) in enumerate(straight))
    assert met < 0.5
    assert min(gap for *_, gap in way) > math.hypot(BODY.length, BODY.width)
    assert way[-1][2] == "open"


def test_the_same_seed_gives_the_same_way():
    def run():
        return [tick[0] for tick in follow(4.0, [(2.0, 1.2, 0.15)], **SIDE)]

    assert run() == run()
