"""Parts of the planner against values by hand, and against the controller's own limits."""

import math

import numpy as np
import pytest
from follower.rooms import BODY, CAMERA, legs, planner_of, scan, standing, wall
from harness import error_of, load_robot
from mecazen import keys
from mecazen.config import FollowerConfig, Scenario
from mecazen.config.follower import PRIORITIES, PidControl, PlannerConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.standoff import Standoff
from mecazen_follower.node import FollowerNode
from mecazen_follower.planner.costs import DISTANCE_M, JERKY, NEAR, Costs, Scene, Sight
from mecazen_follower.planner.field import CELL_M, Field, Shadows
from mecazen_follower.planner.modes import Prediction, Trail, goals_of
from mecazen_follower.planner.movers import Movers
from mecazen_follower.planner.obstacles import MEMORY_S, Surroundings
from mecazen_follower.planner.rollout import Rollout

ORIGIN = Pose2D()
NOTHING = np.empty((0, 2))


def still(x, y, yaw=0.0, steps=3):
    """A robot that stands, by a way of some steps."""
    poses = [np.full((steps, 1), value) for value in (x, y, math.cos(yaw), math.sin(yaw))]
    return Rollout(*poses, np.zeros((steps, 3, 1)))


def scene(points=NOTHING, person=(0.0, 0.0, 0.0), goal=(-1.2, 0.0, 0.0), steps=3):
    """A person who stands, and what else stands."""
    places = np.tile(person, (steps, 1))
    hiding = np.broadcast_to(points, (steps, *points.shape))
    shadows = Shadows(places[:, :2], hiding, np.full(len(points), 0.05))
    goals = np.tile(goal, (steps, 1))
    return Scene(places, goals, np.empty((steps, 0, 2)), points, shadows)


def test_a_way_costs_what_it_gives_up_by_the_priorities():
    costs = Costs(PRIORITIES, 1.2, 0.12, BODY, CAMERA)
    assert costs.weights == pytest.approx(
        {"distance": 27.0, "visibility": 9.0, "bearing": 3.0, "heading": 1.0}
    )
    assert costs.of(still(-1.2, 0.0), scene()) == pytest.approx(0.0, abs=1e-9)
    # 0.25 m too far: (0.25/0.5)² of 27
    assert costs.of(still(-1.45, 0.0), scene()) == pytest.approx(27.0 * (0.25 / DISTANCE_M) ** 2)
    # beyond 0.5 m in proportion: 2·(1.5/0.5) - 1
    assert costs.of(still(-2.7, 0.0), scene()) == pytest.approx(27.0 * 5.0)
    # at the side, facing them: 2(1 - cos 90°) of bearing and of heading
    assert costs.of(still(0.0, 1.2, -math.pi / 2), scene()) == pytest.approx(2.0 * (3.0 + 1.0))
    # turned away by 60°, out of view, heading 2(1 - cos 60°)
    assert costs.of(still(-1.2, 0.0, math.pi / 3), scene()) == pytest.approx(9.0 + 1.0)
    # hidden by a pillar half way; it is 0.6 m away, nothing near
    pillar = np.array([[-0.6, 0.0]])
    assert costs.of(still(-1.2, 0.0), scene(pillar)) == pytest.approx(9.0)
    commands = np.zeros((3, 3, 1))
    commands[1:, 0] = 2.0
    jumping = still(-1.2, 0.0)._replace(commands=commands)
    assert costs.of(jumping, scene()) == pytest.approx(JERKY * 2.0**2)


def test_half_the_clearance_costs_a_quarter_of_contact_and_touching_more_than_all_else():
    costs = Costs(PRIORITIES, 1.2, 0.12, BODY, Sight())
    beside = BODY.width / 2 + BODY.disc  # as far as a quarter's disc reaches
    at = {gap: scene(np.array([[-1.2 - BODY.length / 2, beside + gap]])) for gap in (-0.06, 0.06)}
    near = costs.of(still(-1.2, 0.0), at[0.06])[0]
    # the field is exact to half a cell's diagonal
    off = CELL_M / math.sqrt(2.0)
    low, high = (NEAR * (1.0 - (0.06 + e) / 0.12) ** 2 for e in (off, -off))
    assert low <= near <= high
    assert costs.of(still(-1.2, 0.0), at[-0.06])[0] > 1e4


def test_the_field_has_the_distance_to_the_nearest_point_and_shadows_lie_behind():
    points = np.array([[1.0, 0.5], [-2.0, 1.0]])
    corners = np.full(2, -2.0), np.full(2, 1.0)
    field = Field(points, *corners)
    for x, y in ((0.0, 0.0), (1.0, 0.5), (-1.7, 0.3)):
        exact = min(math.dist((x, y), point) for point in points)
        found = field.distance(np.array([x]), np.array([y]))[0]
        assert found == pytest.approx(exact, abs=CELL_M)
    assert np.isinf(Field(NOTHING, *corners).distance(np.zeros(1), np.zeros(1)))
    shadows = Shadows(np.zeros((1, 2)), points[None], np.full(2, 0.05))
    x, y = np.array([[2.0, 0.8, 2.0, -4.0]]), np.array([[1.0, 0.4, 0.0, 2.0]])
    # beyond the first, before it, beside it, beyond the second
    assert shadows.hide(x, y, np.hypot(x, y)).tolist() == [[True, False, False, True]]


def test_the_trail_leads_round_the_corner_that_the_person_took():
    trail = Trail(1.2)
    for k in range(17):
        trail.add(Pose2D(0.125 * k, 0.0))
    for k in range(1, 5):
        trail.add(Pose2D(2.0, 0.125 * k))
    robot = Pose2D(0.5, 0.0)
    person = Prediction.of(standing((2.0, 0.6, math.pi / 2), (0.0, 0.4)), robot, 4, 0.25)
    goals = goals_of(Standoff(1.2, math.pi, 0.0), person, trail.points(robot))
    place = goals.poses[0, :, -2]  # the trail; the last one is to stay
    # after a step they are at (2, 0.7): 1.2 m before that on their way is (1.5, 0)
    assert place[:2] == pytest.approx((1.0, 0.0))
    facing = math.atan2(0.7, 0.5)
    assert math.remainder(place[2] - facing, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert goals.velocities[0, :2, -2] == pytest.approx((0.4, 0.0))
    assert goals.poses[0, :2, -1] == pytest.approx((0.0, 0.0))
    # besides the place to keep, which is behind, and two aside
    assert goals.poses.shape == (4, 3, 5)


def test_who_walks_is_told_from_what_stands():
    movers = Movers()
    for k in range(15):
        movers.update(0.1 * k, [(0.08 * k, 2.0), (1.0, -1.0)])
    (walker,) = (track for track in movers.tracks if track.walks)
    # after 1.4 s the filter of β = 0.15 is within a tenth of 0.8 m/s
    assert walker[2:4] == pytest.approx((0.8, 0.0), abs=0.08)
    ahead = movers.ahead(np.array([1.4, 2.4]))
    assert ahead.shape == (2, 1, 2)
    assert ahead[1, 0, 0] - ahead[0, 0, 0] == pytest.approx(walker.vx)
    movers.update(3.0, [])
    assert movers.tracks == []


def test_the_persons_legs_are_no_obstacle_and_a_pillar_is():
    around = Surroundings()
    person = Pose2D(1.5, 0.0)
    around.see(0.0, scan(ORIGIN, [*legs(1.5, 0.0), (1.0, 1.5, 0.15)]), ORIGIN, person)
    points = around.standing(ORIGIN)
    assert len(points) >= 2
    assert np.hypot(*(points - (1.0, 1.5)).T) == pytest.approx(0.15, abs=1e-3)
    # a wall as near as that is none of their legs
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


@pytest.mark.parametrize("control", [None, PidControl()])
def test_with_nobody_near_but_the_person_the_command_is_the_laws_own(control):
    config, planner = planner_of({"control": control} if control else None)
    person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
    nominal = Twist2D(0.123456789, -0.2, 0.3)
    for tick in range(30):
        now = 0.05 * tick
        if tick % 2 == 0:
            planner.see(now, scan(ORIGIN, [*legs(1.0, 0.0), (0.0, 3.5, 0.1)]), ORIGIN)
        assert planner.command(now, 0.05, person, ORIGIN, nominal) is nominal
    assert planner.plan == ("open", "")
    assert config.planner is not None


def test_it_says_what_is_in_the_way_and_when():
    _, planner = planner_of()
    person = standing((1.0, 0.0, 0.0), (0.5, 0.0))
    planner.command(0.0, 0.05, person, ORIGIN, Twist2D())
    planner.see(0.0, scan(ORIGIN, [(0.4, 0.25, 0.1)]), ORIGIN)
    command = planner.command(0.05, 0.05, person, ORIGIN, Twist2D(0.5))
    assert planner.plan.state != "open"
    assert planner.plan.reason.startswith("an obstacle is in the way in ")
    planner.forget()
    assert planner.plan.state == "open"
    assert command == planner_command_again(person)


def planner_command_again(person):
    """The same from a planner of the same seed."""
    _, planner = planner_of()
    planner.command(0.0, 0.05, person, ORIGIN, Twist2D())
    planner.see(0.0, scan(ORIGIN, [(0.4, 0.25, 0.1)]), ORIGIN)
    return planner.command(0.05, 0.05, person, ORIGIN, Twist2D(0.5))


def scenario(**planner):
    config = FollowerConfig(planner=PlannerConfig(**planner) if planner else None)
    return Scenario(robot=load_robot(), follower=config)


def test_scans_are_taken_where_there_is_a_planner():
    def takes(scenario):
        return keys.SCAN in {i.topic for i in FollowerNode.row(scenario).inputs}

    assert takes(scenario(samples=200))
    assert not takes(scenario())


def test_a_wrong_setting_is_one_clear_line():
    said = error_of(ConfigError, lambda: FollowerNode(scenario(rate_hz=30.0)))
    assert said.startswith("follower.planner.rate_hz = 30 must divide the tick rate of 100 Hz")
    said = error_of(ValueError, lambda: PlannerConfig(priorities=("distance", "bearing")))
    assert said == (
        "priorities must be distance, visibility, bearing, heading, each once, in any order"
    )
