"""Where the robot should stand, by hand and by properties."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import FollowerConfig
from mecazen.config.follower import VIEWS
from mecazen.geometry import Pose2D, wrap
from planar import poses, standoffs, twists


@pytest.mark.parametrize(
    ("view", "goal"),
    [
        ("back", (2.0, 2.0, math.pi / 2)),
        ("front", (2.0, 4.0, -math.pi / 2)),
        ("side_left", (1.0, 3.0, 0.0)),
        ("side_right", (3.0, 3.0, math.pi)),
    ],
)
def test_views_of_a_person_at_2_3_who_looks_along_y(view, goal):
    person = Pose2D(2.0, 3.0, math.pi / 2)
    pose = FollowerConfig(view=view).standoff.goal(person)
    assert (pose.x, pose.y) == pytest.approx(goal[:2])
    assert wrap(pose.yaw - goal[2]) == pytest.approx(0.0, abs=1e-12)


@given(poses, st.sampled_from(sorted(VIEWS)))
def test_in_every_view_the_robot_looks_at_the_person(person, view):
    goal = FollowerConfig(view=view, standoff_m=2.0).standoff.goal(person)
    seen = goal.between(person)
    assert (seen.x, seen.y) == pytest.approx((2.0, 0.0), abs=1e-9)


@given(poses, standoffs)
def test_at_the_goal_there_is_no_error(person, standoff):
    errors = standoff.errors(person, standoff.goal(person))
    assert errors == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_errors_are_actual_less_wanted_across_the_wrap():
    back = FollowerConfig().standoff
    # 2 m away at a bearing of -170 degrees, turned by -20 degrees.
    bearing = math.radians(-170.0)
    robot = Pose2D(2.0 * math.cos(bearing), 2.0 * math.sin(bearing), math.radians(-20.0))
    errors = back.errors(Pose2D(), robot)
    assert errors == pytest.approx((1.0, math.radians(10.0), math.radians(-20.0)))


@given(poses, twists, standoffs)
def test_goal_velocity_is_the_derivative_of_the_goal(person, velocity, standoff):
    h = 1e-6
    after = Pose2D(
        person.x + velocity.x * h, person.y + velocity.y * h, wrap(person.yaw + velocity.yaw * h)
    )
    a, b = standoff.goal(person), standoff.goal(after)
    expected = standoff.goal_velocity(person, velocity)
    # h/2 of centripetal acceleration, and 1e-14 of rounding over h.
    assert (b.x - a.x) / h == pytest.approx(expected.x, abs=1e-3)
    assert (b.y - a.y) / h == pytest.approx(expected.y, abs=1e-3)
    assert wrap(b.yaw - a.yaw) / h == pytest.approx(expected.yaw, abs=1e-6)
