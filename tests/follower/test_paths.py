"""The planner's paths, goals and costs, against values by hand."""

import math

import numpy as np
import pytest
from follower.rooms import BODY, CAMERA, NOTHING, planner_of, situation, still
from mecazen.config.follower import PlannerConfig
from mecazen.geometry import Standoff
from mecazen_follower.control import ALL_AROUND
from mecazen_follower.planner.costs import DISTANCE_M, JERKY, NEAR, Costs
from mecazen_follower.planner.mppi import STEPS, Prediction, goals_of
from mecazen_follower.planner.surroundings import CELL_M, DistanceField, Shadows

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


def test_nearness_costs_and_contact_costs_most():
    beside = BODY.width / 2 + math.hypot(BODY.length, BODY.width) / 2  # a quarter's disc
    near, touching = (
        EVERYWHERE.evaluate(
            still(-1.2, 0.0), situation(np.array([[-1.2 - BODY.length / 2, beside + gap]]))
        )[0]
        for gap in (0.06, -0.06)
    )
    # the field is exact to half a cell's diagonal
    off = CELL_M / math.sqrt(2.0)
    low, high = (NEAR * (1.0 - (0.06 + error) / 0.12) ** 2 for error in (off, -off))
    assert low <= near <= high
    assert touching > 1e4


def test_the_field_and_shadows_of_points():
    points = np.array([[1.0, 0.5], [-2.0, 1.0]])
    corners = np.full(2, -2.0), np.full(2, 1.0)
    field = DistanceField(points, *corners)
    for x, y in ((0.0, 0.0), (1.0, 0.5), (-1.7, 0.3)):
        exact = min(math.dist((x, y), point) for point in points)
        assert field.distance(np.array([x]), np.array([y]))[0] == pytest.approx(exact, abs=CELL_M)
    assert np.isinf(DistanceField(NOTHING, *corners).distance(np.zeros(1), np.zeros(1)))
    shadows = Shadows(np.zeros((1, 2)), points[None], np.full(2, 0.05))
    x, y = np.array([[2.0, 0.8, 2.0, -4.0]]), np.array([[1.0, 0.4, 0.0, 2.0]])
    # beyond the first, before it, beside it, beyond the second
    assert shadows.hide(x, y, np.hypot(x, y)).tolist() == [[True, False, False, True]]


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


def plan(person, path=None, last="open", points=NOTHING):
    return EVERYWHERE.plan(path or still(0.0, 0.0), situation(points, person), "a wall", last)


@pytest.mark.parametrize(
    ("judged", "state"),
    [
        (plan((1.2, 0.0, 0.0)), "avoiding"),
        (plan((1.7, 0.0, 0.0)), "waiting"),
        (plan((2.2, 0.0, 0.0), still(0.5, 0.0)), "gave_up_distance"),
        (plan((1.2, 0.0, 0.0), points=np.array([[0.6, 0.0]])), "gave_up_visibility"),
        (plan((1.2, 0.0, 0.6), still(0.0, 0.0, 0.6)), "gave_up_bearing"),
        (plan((1.2, 0.0, 0.0), still(0.0, 0.0, 0.6)), "gave_up_heading"),
    ],
)
def test_a_plan_names_what_it_gives_up(judged, state):
    assert judged == (state, "a wall")


@pytest.mark.parametrize("last", ["avoiding", "gave_up_bearing"])
def test_a_priority_is_regained_at_half_the_error(last):
    def aside(degrees):
        angle = math.radians(degrees)
        return plan((1.2 * math.cos(angle), 1.2 * math.sin(angle), 0.0), last=last).state

    assert aside(20.0) == last  # of 30
    assert aside(14.0) == "avoiding"


def test_the_trail_leads_round_corners():
    # positions relative to the robot; the person comes from there at 0.4 m/s, upwards
    trail = np.array([(0.1 * k - 0.5, 0.0) for k in range(21)] + [(1.5, 0.1 * k) for k in (1, 5)])
    poses = np.tile((1.5, 0.7, math.pi / 2), (4, 1))
    person = Prediction(poses, np.tile((0.0, 0.4, 0.0), (4, 1)))
    goals, _ = goals_of(STANDOFF, person, trail)
    # 1.2 m before the person on the path is (1, 0); the last goal is to stay
    assert goals.poses[0, :2, -2] == pytest.approx((1.0, 0.0))
    off = math.remainder(goals.poses[0, 2, -2] - math.atan2(0.7, 0.5), math.tau)
    assert off == pytest.approx(0.0, abs=1e-9)
    assert goals.velocities[0, :2, -2] == pytest.approx((0.4, 0.0))
    assert goals.poses[0, :2, -1] == pytest.approx((0.0, 0.0))
    # besides the place to keep, which is behind, and two aside
    assert goals.poses.shape == (4, 3, 5)


def test_the_mean_of_samples_improves_a_path():
    _, planner = planner_of({"standoff_m": 1.2})
    # the robot rests at the origin, 1.5 m behind a person who stands
    around = situation(person=(1.5, 0.0, 0.0), goal=(0.3, 0.0, 0.0), steps=STEPS)
    nominal = np.zeros((STEPS, 3, 2))
    paths, costs = planner.search(nominal, around)
    assert paths.x.shape == (STEPS, 4)
    assert (paths.commands[..., :2] == nominal).all()
    assert costs[0] == costs[1] == pytest.approx(27.0 * (0.3 / 0.5) ** 2)
    assert (costs[2:] < costs[:2]).all()
    again, _ = planner.search(nominal, around)
    assert (again.commands == paths.commands).all()
