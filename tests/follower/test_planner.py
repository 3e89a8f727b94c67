"""Planner and search in a flat world: the paths and looks of the robot, and its states."""

import math
from collections import deque

import numpy as np
import pytest
from follower.rooms import BODY, CAMERA, DRIVE, TICK, follow, legs, planner_of, scan, standing, wall
from harness import SCENARIOS
from mecazen.config import SensorConfig
from mecazen.config.follower import PidControl
from mecazen.geometry import Pose2D, Standoff, Twist2D
from mecazen.loading import load_scenario, parse_settings
from mecazen_follower.association import Measurement
from mecazen_follower.following import Following
from mecazen_follower.node import make_planner
from mecazen_follower.planner.surroundings import MEMORY_S, LocalMap
from mecazen_follower.search import Search
from mecazen_follower.tracker import Frame
from msgspec.structs import replace

ORIGIN = Pose2D()
SURE = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-3))
NO_RETURN = 13.0
PILLAR = 0.4, 0.25, 0.1
"""In the way of a robot at the origin."""


def test_the_map_keeps_objects_and_drops_legs():
    local_map, person = LocalMap(), Pose2D(1.5, 0.0)
    local_map.see(0.0, scan(ORIGIN, [*legs(1.5, 0.0), (1.0, 1.5, 0.15)]), ORIGIN, person)
    points = local_map.standing(ORIGIN)
    assert len(points) >= 2
    assert np.hypot(*(points - (1.0, 1.5)).T) == pytest.approx(0.15, abs=1e-3)
    # a wall as near as the legs is kept
    local_map.see(0.1, scan(ORIGIN, wall(0.5, 2.5, 0.3)), ORIGIN, person)
    assert len(local_map.standing(ORIGIN)) > 10  # of 2 m, a point each 10 cm; aslant less


def test_hidden_points_are_remembered_for_a_while():
    pillar, removed, screen = (2.0, 0.0, 0.1), (0.0, 2.0, 0.1), (1.0, 0.0, 0.2)
    local_map, away = LocalMap(), Pose2D(-5.0, 0.0)

    def has(circle):
        gaps = np.hypot(*(local_map.standing(ORIGIN) - circle[:2]).T)
        return bool((gaps < 0.15).any())

    local_map.see(0.0, scan(ORIGIN, [pillar, removed]), ORIGIN, away)
    local_map.see(0.1, scan(ORIGIN, [screen]), ORIGIN, away)
    assert (has(pillar), has(removed)) == (True, False)
    local_map.see(MEMORY_S + 0.1, scan(ORIGIN, [screen]), ORIGIN, away)
    assert not has(pillar)


@pytest.mark.parametrize(
    ("services", "state"),
    [(["hardware", "controller"], "open"), (["physics", "controller"], "avoiding")],
)
def test_0_is_no_return_of_a_real_lidar(services, state):
    settings = f"services={services}", 'sensor.also=["lidar"]', "follower.planner={samples=100}"
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(settings))
    planner, person = make_planner(scenario, scenario.sensor, 1), standing((1.0, 0.0, 0.0))
    planner.command(0.0, TICK, person, ORIGIN, Twist2D())
    planner.see(0.0, scan(ORIGIN, [PILLAR, *legs(1.0, 0.0)]), ORIGIN)
    planner.command(0.2, TICK, person, ORIGIN, Twist2D())
    assert planner.plan.state == "avoiding"
    free = scan(ORIGIN, legs(1.0, 0.0))
    ranges = tuple(0.0 if value == NO_RETURN else value for value in free.ranges)
    planner.see(0.3, replace(free, ranges=ranges), ORIGIN)
    planner.command(0.4, TICK, person, ORIGIN, Twist2D())
    assert planner.plan.state == state


@pytest.mark.parametrize("control", [None, PidControl()])
def test_in_open_space_the_command_is_unchanged(control):
    _, planner = planner_of({"control": control} if control else None)
    person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
    nominal = Twist2D(0.123456789, -0.2, 0.3)
    for tick in range(30):
        if tick % 2 == 0:
            circles = [*legs(1.0, 0.0), (0.0, 3.5, 0.1)]
            planner.see(TICK * tick, scan(ORIGIN, circles), ORIGIN)
        assert planner.command(TICK * tick, TICK, person, ORIGIN, nominal) is nominal
    assert planner.plan == ("open", "")


def test_plan_names_the_obstacle_until_reset():
    def command():
        _, planner = planner_of()
        person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
        planner.command(0.0, TICK, person, ORIGIN, Twist2D())
        planner.see(0.0, scan(ORIGIN, [PILLAR]), ORIGIN)
        return planner.command(TICK, TICK, person, ORIGIN, Twist2D(0.5)), planner

    first, planner = command()
    assert planner.plan.state != "open"
    assert planner.plan.reason.startswith("an obstacle is in the way in ")
    planner.forget()
    assert planner.plan.state == "open"
    assert command()[0] == first  # the same seed


SIDE = {"view": "side_left", "standoff_m": 1.2}
BESIDE = Standoff(1.2, math.pi / 2, -math.pi / 2)
NARROWEST = min(BODY.length, BODY.width)
"""From the middle of the robot to its nearest side [m]."""


def bearings(path):
    """Return the robot's bearing about the person minus that of `BESIDE`, at each tick [deg]."""
    return [math.degrees(BESIDE.errors(person, robot).bearing) for robot, person, *_ in path]


def test_a_pillar_is_passed_and_the_side_regained():
    path = list(follow(10.0, [(3.0, 1.2, 0.15)], **SIDE))
    assert min(gap for *_, gap in path) > NARROWEST + 0.05  # of the 0.12 m: cells of 6 cm
    assert {state for _, _, state, _ in path} >= {"open", "avoiding"}
    assert path[-1][2] == "open"
    assert bearings(path)[-1] == pytest.approx(0.0, abs=2.0)  # the law returns to the side
    assert all(abs(robot.distance(person) - 1.2) < 0.3 for robot, person, *_ in path)


def test_before_a_narrow_gap_the_robot_waits():
    room = [(3.0, sign * (0.22 + 0.05 * k), 0.03) for k in range(60) for sign in (1, -1)]
    *_, (robot, person, state, _) = path = list(follow(11.0, room, **SIDE))
    assert state == "waiting"
    assert robot.x < 3.0 < person.x
    assert min(gap for *_, gap in path) > NARROWEST


def test_a_crossing_walker_may_pass():
    # the walker would meet the robot behind its person at 3 s
    walker, behind = (1.8, 4.2, 0.0, -0.8), {"view": "back", "standoff_m": 1.2}
    path, straight = (list(follow(7.0, [], walkers, **behind)) for walkers in ([walker], []))
    gaps = [
        math.dist(robot[:2], (1.8, 4.2 - 0.8 * TICK * k)) for k, (robot, *_) in enumerate(straight)
    ]
    assert min(gaps) < 0.5
    assert min(gap for *_, gap in path) > math.hypot(BODY.length, BODY.width)
    assert path[-1][2] == "open"


@pytest.mark.parametrize("walkers", [[], [(0.9, 0.5)]], ids=["alone", "with a walker"])
def test_all_are_predicted_over_the_dead_time(walkers):
    # At 1.3 m/s and 0.5 s robot, person and walkers are 0.65 m farther when the robot responds. Any
    # of them at another time is in the way: the person's legs, or the walker, 1.03 m away.
    config, planner = planner_of({"response_s": 0.5, "standoff_m": 1.2})
    following = Following(config, SensorConfig(), DRIVE, planner=planner)
    robot, twist, plans = Pose2D(), Twist2D(1.3), []
    sent = deque([twist] * 10)
    for tick in range(60):
        time, x = TICK * tick, 1.3 * TICK * tick
        circles = [leg for dx, y in [(1.2, 0.0), *walkers] for leg in legs(x + dx, y)]
        planner.see(time, scan(robot, circles), robot)
        frame = Frame(time, (Measurement(Pose2D(x + 1.2, 0.0), SURE),))
        step = following.step(time, TICK, robot, frame)
        plans.append(step.plan.state)
        sent.append(step.command)
        twist = DRIVE.step(twist, sent.popleft(), 2.0, TICK)
        robot = robot.integrate(twist, TICK)
    # the estimate has no velocity at first
    assert set(plans[20:]) == {"open"}


CORNER = [*wall(-2.0, 3.0, 1.0), *wall(-2.0, 5.0, -1.0)]
CORNER += [(y, x, radius) for x, y, radius in (*wall(-1.0, 6.0, 5.0), *wall(1.0, 6.0, 3.0))]
"""A corridor along x, 2 m wide, that turns to the left at x = 4."""
ROOM = [*wall(-2.0, 2.0, 2.0), *wall(-2.0, 2.0, -2.0)]
ROOM += [(y, x, radius) for x, y, radius in ROOM]
LAST_SEEN = standing((3.0, 0.0, 0.0), (0.8, 0.0))


def search_of(person=LAST_SEEN):
    return Search(person, CAMERA, (BODY.length, BODY.width))


def look_after(search, circles, robot, strangers=()):
    search.see(scan(robot, circles, beams=720, std=0.01), robot, robot)
    return search.look(robot, strangers)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_opening_on_the_persons_way_comes_first(side):
    posts = [*wall(-2.0, 2.0, side), *wall(3.0, 5.0, side), *wall(-2.0, 2.0, -side)]
    posts += [*wall(3.0, 5.0, -side), *((5.0, y, 0.03) for y in np.arange(-1.0, 1.0, 0.05))]
    walks = standing((2.3, 0.5 * side, 0.0), (0.3, 0.5 * side))
    look = look_after(search_of(walks), posts, Pose2D(0.8))
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
def test_search_looks_at_plausible_legs_only(place, strangers, looks):
    search = search_of(standing((0.0, 0.0, 0.0)))
    look = look_after(search, [*ROOM, *legs(*place)], ORIGIN, strangers)
    assert (look is not None) == looks
    if looks:
        assert look.reason == "something like legs"
        assert look.way == pytest.approx(ORIGIN[:2])
        assert math.dist(look.place, place) < 0.2


def test_robot_at_a_wall_moves_before_it_turns():
    look = look_after(search_of(), CORNER, Pose2D(2.5, 0.74, 1.5))
    assert look.place == pytest.approx((2.5, 0.74))
