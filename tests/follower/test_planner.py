"""Planner and search: costs by hand, and the robot's paths and looks in a flat world."""

import math
from collections import deque

import numpy as np
import pytest
from follower.rooms import (
    BODY,
    CAMERA,
    DRIVE,
    NOTHING,
    TICK,
    follow,
    legs,
    planner_of,
    scan,
    situation,
    standing,
    still,
    wall,
)
from follower.stepped import Follower
from mecazen.config.follower import PidControl, PlannerConfig, PolarControl
from mecazen.geometry import Pose2D, Standoff, Twist2D, wrap
from mecazen.messages import Header, Time, diagonal_covariance
from mecazen_follower.planner.costs import DISTANCE_M, JERKY, Costs
from mecazen_follower.planner.surroundings import MEMORY_S, LocalMap
from mecazen_follower.search import Search
from mecazen_follower.sight import ALL_AROUND
from msgspec.structs import replace

ORIGIN = Pose2D()
SURE = diagonal_covariance((1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-3))


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


@pytest.mark.parametrize("config", [{}, {"control": PidControl()}], ids=["polar", "pid"])
def test_in_open_space_the_command_is_unchanged(config):
    _, planner = planner_of(config)
    person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
    nominal = Twist2D(0.123456789, -0.2, 0.3)
    for tick in range(30):
        if tick % 2 == 0:
            circles = [*legs(1.0, 0.0), (0.0, 3.5, 0.1)]
            planner.see(TICK * tick, scan(ORIGIN, circles), ORIGIN)
        assert planner.command(TICK * tick, TICK, person, ORIGIN, nominal) is nominal
    assert planner.plan == ("open", "")


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


def test_robot_follows_behind_in_a_corridor():
    front = [(3.0, side * y, 0.03) for side in (-1.0, 1.0) for y in np.arange(0.85, 2.5, 0.05)]
    path = list(follow(14.0, wall(3.0, 6.0, 0.85) + wall(3.0, 6.0, -0.85) + front, **SIDE))
    angles = bearings(path)
    within = [angles[k] for k, (robot, *_) in enumerate(path) if 3.5 < robot.x < 5.5]
    assert within
    assert min(within) > 45.0  # nearer to behind, 90 degrees away, than to the side
    assert "gave_up_bearing" in {state for _, _, state, _ in path}
    assert path[-1][2] == "open"
    assert angles[-1] == pytest.approx(0.0, abs=2.0)
    assert min(gap for *_, gap in path) > NARROWEST + 0.05
    for robot, person, *_ in path:  # in view all the time
        bearing = math.atan2(person.y - robot.y, person.x - robot.x)
        assert abs(math.degrees(wrap(bearing - robot.yaw))) < 37.5


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
    follower = Follower(
        TICK,
        estimator="imm",
        control=PolarControl(),
        planner=PlannerConfig(samples=400),
        response_s=0.5,
        standoff_m=1.2,
    )
    robot, twist, plans = Pose2D(), Twist2D(1.3), []
    sent = deque([twist] * 10)
    for tick in range(60):
        x = 1.3 * TICK * tick
        circles = [leg for dx, y in [(1.2, 0.0), *walkers] for leg in legs(x + dx, y)]
        now = Header(Time.from_ns(tick * follower.tick_ns))
        seen = scan(robot.compose(follower.node.lidar.pose), circles)
        command, state = follower.tick(
            tick,
            robot,
            Pose2D(x + 1.2, 0.0),
            seen_in="odom",
            noise=SURE,
            scan=replace(seen, header=now),
        )
        plans.append(state.plan)
        sent.append(command)
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


STANDOFF = Standoff(1.2, math.pi, 0.0)
CONFIG = PlannerConfig(clearance_m=0.12)
EVERYWHERE = Costs(CONFIG, STANDOFF, BODY, ALL_AROUND)


def test_costs_follow_the_priorities():
    costs = Costs(CONFIG, STANDOFF, BODY, CAMERA)
    assert costs.weights == {"distance": 27.0, "visibility": 9.0, "bearing": 3.0, "heading": 1.0}
    assert costs.evaluate(still(-1.2, 0.0), situation()) == pytest.approx(0.0, abs=1e-9)
    # 0.25 m too far: (0.25/0.5)² of 27
    too_far = costs.evaluate(still(-1.45, 0.0), situation())
    assert too_far == pytest.approx(27.0 * (0.25 / DISTANCE_M) ** 2)
    # beyond 0.5 m in proportion: 2·(1.5/0.5) - 1
    assert costs.evaluate(still(-2.7, 0.0), situation()) == pytest.approx(27.0 * 5.0)
    # at the side, facing the person: 2(1 - cos 90°) of bearing and of heading
    beside = costs.evaluate(still(0.0, 1.2, -math.pi / 2), situation())
    assert beside == pytest.approx(2.0 * (3.0 + 1.0))
    # turned away by 60°, out of view, heading 2(1 - cos 60°)
    assert costs.evaluate(still(-1.2, 0.0, math.pi / 3), situation()) == pytest.approx(9.0 + 1.0)
    # hidden by a pillar half way; it is 0.6 m away, nothing near
    pillar = np.array([[-0.6, 0.0]])
    assert costs.evaluate(still(-1.2, 0.0), situation(pillar)) == pytest.approx(9.0)
    commands = np.zeros((3, 3, 1))
    commands[1:, 0] = 2.0
    jumping = still(-1.2, 0.0)._replace(commands=commands)
    assert costs.evaluate(jumping, situation()) == pytest.approx(JERKY * 2.0**2)


def blocked(points=NOTHING, walkers=None, evades=False):
    """Return what blocks a robot at the origin, whose person is 1.2 m ahead."""
    around = situation(points, person=(1.2, 0.0, 0.0), walkers=walkers)
    return EVERYWHERE.blocked(still(0.0, 0.0), around, 0.25, evades=evades)


def test_points_walkers_and_shadows_block_a_path():
    beside = np.array([[0.0, -BODY.width - 0.13]])
    assert blocked(beside) == ""
    assert blocked(beside, evades=True) == "an obstacle is in the way in 0.2 s"  # of 0.25
    near = BODY.circle + 0.1
    coming = np.array([[[0.0, 3.0]], [[0.0, near]], [[0.0, near]]])
    assert blocked(walkers=coming) == "a walker crosses the path in 0.5 s"
    assert blocked(walkers=coming[:1].repeat(3, axis=0)) == ""
    assert blocked(np.array([[0.8, 0.0]])) == "the person would be hidden in 0.2 s"
