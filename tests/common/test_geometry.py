"""Planar poses against figures worked out by hand, and their algebra for any pose."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, overlap, rotate, wrap

ROUNDING = 1e-12
"""A few roundings of numbers of at most 100: 100 times 2⁻⁵² is 2e-14."""

lengths = st.floats(-100.0, 100.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2D, lengths, lengths, angles)
twists = st.builds(Twist2D, st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))


def assert_same(pose, expected, tolerance=ROUNDING):
    assert pose.x == pytest.approx(expected.x, abs=tolerance)
    assert pose.y == pytest.approx(expected.y, abs=tolerance)
    assert abs(wrap(pose.yaw - expected.yaw)) <= tolerance


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (3.0 * math.pi, math.pi),
        (math.tau, 0.0),
        (-math.tau, 0.0),
        (1.5 * math.pi, -0.5 * math.pi),
        (-1.5 * math.pi, 0.5 * math.pi),
        (math.nextafter(math.pi, 4.0), -math.pi),
        (0.3, 0.3),
    ],
)
def test_an_angle_wraps_into_minus_pi_excluded_to_pi(angle, expected):
    assert wrap(angle) == pytest.approx(expected, abs=1e-15)
    assert -math.pi < wrap(angle) <= math.pi


@given(st.floats(-1e6, 1e6))
def test_a_wrapped_angle_is_the_same_direction_and_stays_when_wrapped_again(angle):
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert wrap(wrapped) == wrapped
    # tau is not 2 pi exactly: off by 2.4e-16, times up to 1.6e5 turns
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-10)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-10)


def test_compose_expect_the_child_turned_and_shifted_into_the_parent():
    # facing left at (1, 2), a point 3 ahead and 1 to the left is 3 up and 1 back
    parent = Pose2D(1.0, 2.0, math.pi / 2)
    assert_same(parent.compose(Pose2D(3.0, 1.0, 0.5)), Pose2D(0.0, 5.0, math.pi / 2 + 0.5))


@given(poses, poses)
def test_between_undoes_compose(a, b):
    assert_same(a.between(a.compose(b)), b)
    assert_same(a.compose(a.between(b)), b)


def test_integrate_a_quarter_circle_expect_its_end_to_the_left():
    # radius v / w = 2: from the origin facing x to (2, 2) facing y
    pose = Pose2D().integrate(Twist2D(x=1.0, yaw=0.5), math.pi)
    assert_same(pose, Pose2D(2.0, 2.0, math.pi / 2))


@given(poses, twists, st.floats(1e-6, 2.0), st.integers(2, 7))
def test_integrate_in_parts_is_integrate_in_one(pose, twist, dt, parts):
    stepped = pose
    for _ in range(parts):
        stepped = stepped.integrate(twist, dt / parts)
    assert_same(stepped, pose.integrate(twist, dt))


@pytest.mark.parametrize("angle", [1e-9, 0.99e-4, 1.01e-4, 1e-3, -1.01e-4])
def test_integrate_a_hardly_bent_arc_keeps_its_digits(angle):
    # to the side it is a/2 - a³/24 + a⁵/720 …, whose next term is below 1e-18 of the first
    side = angle / 2 - angle**3 / 24 + angle**5 / 720
    assert Pose2D().integrate(Twist2D(x=1.0, yaw=angle), 1.0).y == pytest.approx(side, rel=1e-14)


def test_distance_is_that_of_the_origins():
    assert Pose2D(1.0, 1.0, 2.0).distance(Pose2D(4.0, 5.0, -1.0)) == 5.0


def test_rotate_a_quarter_turn_expect_x_to_become_y():
    x, y = rotate(2.0, 1.0, math.pi / 2)
    assert (x, y) == pytest.approx((-1.0, 2.0), abs=ROUNDING)


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (Pose2D(3.9, 0.0), True),  # 4 m long, one behind the other
        (Pose2D(4.1, 0.0), False),
        (Pose2D(0.0, 1.9), True),  # 2 m wide, side by side
        (Pose2D(0.0, 2.1), False),
        (Pose2D(2.9, 0.0, math.pi / 2), True),  # across: 2 m and 1 m
        (Pose2D(3.1, 0.0, math.pi / 2), False),
        (Pose2D(0.0, 3.1, math.pi / 2), False),
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
