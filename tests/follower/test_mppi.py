"""The planner's law, rollouts, goals and search, against values by hand."""

import math

import numpy as np
import pytest
from follower.rooms import planner_of, situation
from mecazen.config.follower import PolarControl
from mecazen.drive import Drive, Limits, MotionLimits
from mecazen.geometry import Standoff, Twist2D
from mecazen_follower.planner.mppi import STEPS, Course, goals_of, roll, towards

LAW = PolarControl(heading_gain_1_s=4.0)
BEHIND = -1.0, 0.0, 0.0
LINEAR = Limits(2.0, 2.5, 2.5)
DT = 0.1
LIMITS = MotionLimits(
    Drive(2.0, 1.0, 0.3, (LINEAR, LINEAR, Limits(3.0, 8.0, 8.0))), max_speed=2.0, dt=DT, n=1
)


def commanded(place, velocity=(0.0, 0.0, 0.0), orbit=0.0):
    """Return what is commanded at a place; the goal is 1 m behind a person at the origin."""
    goals = Course(*(np.array(row)[None, :, None] for row in (BEHIND, velocity)))
    command = towards(np.zeros((1, 3)), goals, np.array([orbit]), LAW)
    return command(0, *np.array(place)[:, None])[:, 0]


@pytest.mark.parametrize(
    ("place", "command"),
    [
        (BEHIND, (0.0, 0.0, 0.0)),
        ((-1.1, 0.0, 0.0), (0.3, 0.0, 0.0)),
        ((-5.0, 0.0, 0.0), (4.0, 0.0, 0.0)),  # v² = 2 * 2 m/s² * 4 m
        ((0.0, -1.0, 0.0), (-math.sqrt(2.0 * math.pi), 0.0, 0.0)),  # a quarter of a circle
        ((-1.0, 0.0, -0.1), (0.0, 0.0, 0.4)),
        ((-1.0, 0.0, 2.0), (0.0, 0.0, -3.0)),
        ((-1.0, 0.0, math.tau + 0.1), (0.0, 0.0, -0.4)),
    ],
)
def test_a_resting_goal_is_approached_along_circle_and_radius(place, command):
    assert commanded(place) == pytest.approx(command, abs=1e-12)


@pytest.mark.parametrize(("velocity", "orbit"), [((0.5, 0.2, 0.0), 0.0), ((0.0, -0.5, 0.5), 0.5)])
def test_at_the_goal_the_robot_moves_with_it(velocity, orbit):
    assert commanded(BEHIND, velocity, orbit) == pytest.approx(velocity)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_from_rest_a_rollout_is_limited_by_the_acceleration(yaw):
    path = roll(yaw, Twist2D(), 3, LIMITS, lambda *_: np.array([[0.0], [2.0], [0.0]]))
    reach = 1.25 * (DT * np.arange(1, 4)) ** 2  # half of 2.5 m/s² times t²
    assert path.y[:, 0] == pytest.approx(reach)
    assert path.x[:, 0] == pytest.approx(np.zeros(3), abs=1e-12)
    assert path.s[:, 0] == pytest.approx(math.sin(yaw))


def test_a_rollout_with_a_steady_turn_is_a_circle():
    def ahead(_, x, y, yaw):
        return np.array((np.cos(yaw), np.sin(yaw), np.ones_like(yaw)))

    path = roll(0.0, Twist2D(1.0, 0.0, 1.0), 10, LIMITS, ahead)
    # the mean of both directions is shorter than the chord by a twelfth of the step's turn squared
    circle = math.sin(1.0), 1.0 - math.cos(1.0)
    assert (path.x[-1, 0], path.y[-1, 0]) == pytest.approx(circle, rel=DT**2 / 6)


def test_the_trail_leads_round_the_corner_that_the_person_took():
    # positions relative to the robot; the person comes from there at 0.4 m/s, upwards
    trail = np.array([(0.1 * k - 0.5, 0.0) for k in range(21)] + [(1.5, 0.1 * k) for k in (1, 5)])
    poses = np.tile((1.5, 0.7, math.pi / 2), (4, 1))
    person = Course(poses, np.tile((0.0, 0.4, 0.0), (4, 1)))
    goals, _ = goals_of(Standoff(1.2, math.pi, 0.0), person, trail)
    # 1.2 m before the person on the path is (1, 0); the last goal is to stay
    assert goals.poses[0, :2, -2] == pytest.approx((1.0, 0.0))
    off = math.remainder(goals.poses[0, 2, -2] - math.atan2(0.7, 0.5), math.tau)
    assert off == pytest.approx(0.0, abs=1e-9)
    assert goals.velocities[0, :2, -2] == pytest.approx((0.4, 0.0))
    assert goals.poses[0, :2, -1] == pytest.approx((0.0, 0.0))
    # besides the place to keep, which is behind, and two aside
    assert goals.poses.shape == (4, 3, 5)


def test_the_mean_of_cheap_samples_costs_less_than_the_nominal_path():
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
