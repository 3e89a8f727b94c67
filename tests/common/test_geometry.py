"""Poses, places beside a person and rotations, by hand and by their algebra."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen import arrays
from mecazen.config import FollowerConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, PoseHistory, Twist2D, overlap, rotate, wrap
from planar import poses, standoffs, twists

ROUNDING = 1e-12
"""A few roundings of numbers of at most 100: 100 times 2⁻⁵² is 2e-14."""
MS = 1_000_000

coordinates = st.floats(-10.0, 10.0)
points = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=5)


def assert_same(pose, expected):
    assert pose[:2] == pytest.approx(expected[:2], abs=ROUNDING)
    assert abs(wrap(pose.yaw - expected.yaw)) <= ROUNDING


def test_an_angle_wraps_into_minus_pi_excluded_to_pi():
    for angle, expected in (
        (-math.pi, math.pi),
        (3.0 * math.pi, math.pi),
        (-math.tau, 0.0),
        (1.5 * math.pi, -0.5 * math.pi),
        (math.nextafter(math.pi, 4.0), -math.pi),
        (0.3, 0.3),
    ):
        assert wrap(angle) == pytest.approx(expected, abs=1e-15)
        assert -math.pi < wrap(angle) <= math.pi


def test_compose_turns_and_shifts_the_child_into_the_parent():
    # facing left at (1, 2), a point 3 ahead and 1 to the left is 3 up and 1 back
    parent = Pose2D(1.0, 2.0, math.pi / 2)
    assert_same(parent.compose(Pose2D(3.0, 1.0, 0.5)), Pose2D(0.0, 5.0, math.pi / 2 + 0.5))


@given(poses, poses)
def test_between_undoes_compose(a, b):
    assert_same(a.between(a.compose(b)), b)
    assert_same(a.compose(a.between(b)), b)


@given(poses, twists, st.floats(1e-6, 2.0), st.integers(2, 7))
def test_integration_in_parts_equals_integration_at_once(pose, twist, dt, parts):
    stepped = pose
    for _ in range(parts):
        stepped = stepped.integrate(twist, dt / parts)
    assert_same(stepped, pose.integrate(twist, dt))


@pytest.mark.parametrize("angle", [1e-9, 0.99e-4, 1.01e-4, -1.01e-4])
def test_a_hardly_bent_arc_keeps_its_digits(angle):
    # to the side it is a/2 - a³/24 + a⁵/720 …, whose next term is below 1e-18 of the first
    side = angle / 2 - angle**3 / 24 + angle**5 / 720
    assert Pose2D().integrate(Twist2D(x=1.0, yaw=angle), 1.0).y == pytest.approx(side, rel=1e-14)


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (Pose2D(3.9, 0.0), True),  # 4 m long, one behind the other
        (Pose2D(4.1, 0.0), False),
        (Pose2D(0.0, 2.1), False),  # 2 m wide, side by side
        (Pose2D(2.9, 0.0, math.pi / 2), True),  # across: 2 m and 1 m
        (Pose2D(3.1, 0.0, math.pi / 2), False),
        # the corner of one at 45° lies (2 + 1)/√2 from its middle, short of the other's side
        (Pose2D(2.0 + 3.0 / math.sqrt(2.0) + 0.01, 0.0, math.pi / 4), False),
        (Pose2D(2.0 + 3.0 / math.sqrt(2.0) - 0.7, 0.0, math.pi / 4), True),
        # corners that only circles or boxes along x and y would take for touching
        (Pose2D(3.4, 2.6, math.pi / 4), False),
    ],
)
def test_rectangles_overlap_unless_a_line_parts_them(pose, expected):
    half = (2.0, 1.0)
    assert overlap(Pose2D(), half, pose, half) is expected
    assert overlap(pose, half, Pose2D(), half) is expected


@pytest.mark.parametrize(
    ("view", "goal"),
    [
        ("back", (2.0, 2.0, math.pi / 2)),
        ("front", (2.0, 4.0, -math.pi / 2)),
        ("side_left", (1.0, 3.0, 0.0)),
        ("side_right", (3.0, 3.0, math.pi)),
    ],
)
def test_views_of_a_person_who_faces_y(view, goal):
    person = Pose2D(2.0, 3.0, math.pi / 2)
    assert_same(FollowerConfig(view=view).standoff.goal(person), Pose2D(*goal))


@given(poses, standoffs)
def test_the_goal_has_no_errors_and_leads_back_to_the_person(person, standoff):
    goal = standoff.goal(person)
    assert standoff.errors(person, goal) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert_same(standoff.person(goal), person)


def test_errors_are_actual_less_desired_across_the_wrap():
    # 2 m away at a bearing of -170 degrees, turned by -20 degrees
    bearing = math.radians(-170.0)
    robot = Pose2D(2.0 * math.cos(bearing), 2.0 * math.sin(bearing), math.radians(-20.0))
    errors = FollowerConfig().standoff.errors(Pose2D(), robot)
    assert errors == pytest.approx((1.0, math.radians(10.0), math.radians(-20.0)))


@given(poses, twists, standoffs)
def test_the_velocity_of_the_goal_is_its_derivative(person, velocity, standoff):
    h = 1e-6
    after = Pose2D(*(value + rate * h for value, rate in zip(person, velocity, strict=True)))
    begin, end = standoff.goal(person), standoff.goal(after)
    expected = standoff.goal_velocity(person, velocity)
    # h/2 of centripetal acceleration, and 1e-14 of rounding over h
    assert (end.x - begin.x) / h == pytest.approx(expected.x, abs=1e-3)
    assert (end.y - begin.y) / h == pytest.approx(expected.y, abs=1e-3)
    assert wrap(end.yaw - begin.yaw) / h == pytest.approx(expected.yaw, abs=1e-6)


def history(*poses: Pose2D, kept_ms: int = 1000) -> PoseHistory:
    """Return the history of poses every 10 ms."""
    made = PoseHistory(kept_ms * MS)
    for number, pose in enumerate(poses):
        made.add(number * 10 * MS, pose)
    return made


def test_a_history_returns_known_poses_and_interpolates_between_them():
    line = [Pose2D(0.1 * n, -0.3 * n, 0.7 * n) for n in range(4)]
    made = history(*line)
    assert [made.at(n * 10 * MS) for n in range(4)] == line
    assert_same(made.at(25 * MS), Pose2D(0.25, -0.75, 1.75))
    pose = history(Pose2D(yaw=math.pi - 0.1), Pose2D(yaw=-math.pi + 0.3)).at(5 * MS)
    assert pose.yaw == pytest.approx(-math.pi + 0.1)  # the shorter way
    assert history(*line, kept_ms=10).at(0) == line[-1]  # time 0 is no time: the newest


@pytest.mark.parametrize(
    ("number", "kept_ms", "time_ns", "known"),
    [
        (4, 1000, 31 * MS, "0 to 0.03 s"),
        (4, 10, 10 * MS, "0.02 to 0.03 s"),
        (0, 10, 5, "no time"),
    ],
)
def test_a_time_outside_of_the_history_is_refused(number, kept_ms, time_ns, known):
    with pytest.raises(RefusedError, match=rf"no pose is known of .* s, only of {known}"):
        history(*[Pose2D()] * number, kept_ms=kept_ms).at(time_ns)


@given(poses, points)
def test_arrays_of_points_are_placed_as_single_poses(frame, places):
    xy = np.array(places)
    composed = arrays.compose(frame, xy)
    single = [frame.compose(Pose2D(*place))[:2] for place in places]
    assert composed == pytest.approx(np.array(single), abs=ROUNDING)
    assert arrays.between(frame, composed) == pytest.approx(xy, abs=ROUNDING)


def test_a_point_inside_is_as_deep_as_its_nearest_side():
    distances = arrays.to_rectangle([0.9, 2.0, 0.0], [0.0, -1.5, 0.7], (1.0, 0.5))
    assert distances == pytest.approx([-0.1, 2.0**0.5, 0.2])


def test_a_quarter_turn_brings_x_to_y():
    assert rotate(2.0, 1.0, math.pi / 2) == pytest.approx((-1.0, 2.0))
    turned = arrays.rotate(np.array([2.0, 1.0, 3.0]), -math.pi / 2)
    assert turned == pytest.approx((1.0, -2.0, 3.0))


def test_roll_pitch_and_yaw_turn_about_the_fixed_axes_in_that_order():
    roll, pitch, yaw = 0.3, -0.4, 1.2
    rotation = arrays.quaternions_of_rpy((roll, pitch, yaw))
    x_axis, _, z_axis = arrays.turn(np.array([rotation] * 3), np.eye(3))
    # the textbook's matrix of Rz·Ry·Rx: its first and last column
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    assert x_axis == pytest.approx((cy * cp, sy * cp, -sp))
    assert z_axis == pytest.approx((cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr))
    back = arrays.quaternions_about((1.0, 0.0, 0.0), -roll)
    level = arrays.chain(rotation, back)
    assert arrays.turn(level, (0.0, 1.0, 0.0)) == pytest.approx((-sy, cy, 0.0))
