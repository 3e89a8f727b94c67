"""Paths of a person: curves, scripts, commands and gait; the twist is the pose's derivative."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config.people import (
    Circle,
    FigureOfEight,
    Gait,
    Script,
    ScriptStep,
    Standing,
    Straight,
    UTrack,
    Wander,
    Waypoints,
)
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen_people.curves import Lemniscate
from mecazen_people.motion import with_gait
from mecazen_people.paths import TwistWalk, make_path, scripted
from people.walks import differences

POINTS = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (-1.0, 4.0), (1.0, 5.0), (5.0, 4.0))
PATHS = {
    "u_track": UTrack(x_m=1.0, y_m=-2.0, yaw_deg=30.0, start_after_s=1.0),
    "u_track to the right": UTrack(turn="right"),
    "straight": Straight(speed_m_s=0.7, yaw_deg=-120.0),
    "circle": Circle(radius_m=1.5, speed_m_s=0.5, turn="right"),
    "figure_of_eight": FigureOfEight(speed_m_s=0.9, yaw_deg=77.0),
    "figure_of_eight to the right": FigureOfEight(length_m=3.0, turn="right"),
    "waypoints": Waypoints(points_m=POINTS, speed_m_s=0.8, yaw_deg=10.0),
    "there and back": Waypoints(points_m=POINTS, speed_m_s=1.0, back_and_forth=True),
    "standing": Standing(x_m=2.0, yaw_deg=90.0),
    "script": Script(
        steps=(
            ScriptStep(duration_s=2.0, speed_m_s=0.8, yaw_rate_deg_s=20.0),
            ScriptStep(duration_s=2.0, speed_m_s=0.5, direction_deg=120.0),
        ),
        start_after_s=0.5,
    ),
    "wander": Wander(number=3, start_after_s=0.5),
}


GAIT = Gait(sway_m=0.03, speed_ripple=0.1, step_length_m=0.5)
CELL_S = 0.005
"""Duration of a constant velocity within a script."""


@pytest.mark.parametrize(
    ("t", "pose", "twist"),
    [
        (-1.0, Pose2D(0.0, 0.0, 0.0), Twist2D()),
        (0.0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0)),
        (10.0, Pose2D(2.0, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0)),
        # A quarter of the circle: 5 + 2 forward, 2 to the left.
        (25.0 + 5.0 * math.pi, Pose2D(7.0, 2.0, math.pi / 2), Twist2D(0.2, 0.0, 0.1)),
        # 10 s after the half circle, which ends at (5, 4).
        (35.0 + 10.0 * math.pi, Pose2D(3.0, 4.0, math.pi), Twist2D(0.2, 0.0, 0.0)),
        (100.0, Pose2D(0.0, 4.0, math.pi), Twist2D()),
    ],
)
def test_u_track_is_the_papers(t, pose, twist):
    motion = make_path(UTrack()).at(t)
    # Sums of a few rounded numbers below 100.
    assert motion.pose == pytest.approx(pose, abs=1e-12)
    assert motion.twist == pytest.approx(twist, abs=1e-12)


def test_waypoints_are_passed_in_order():
    path = make_path(Waypoints(points_m=POINTS, speed_m_s=1.0))
    walked = [path.at(0.001 * k).pose for k in range(round(path.duration * 1000) + 2)]
    nearest = [
        min(range(len(walked)), key=lambda k: math.dist(walked[k][:2], point)) for point in POINTS
    ]
    assert nearest == sorted(nearest)
    for k, point in zip(nearest, POINTS, strict=True):
        assert math.dist(walked[k][:2], point) < 1e-3  # a step of the search is 1 mm
    assert path.at(path.duration + 9.0).pose[:2] == pytest.approx(POINTS[-1], abs=1e-12)
    assert path.at(path.duration + 9.0).twist == Twist2D()


def test_person_turns_at_the_end_and_returns():
    path = make_path(Straight(length_m=2.0, speed_m_s=0.5, start_after_s=1.0, back_and_forth=True))
    assert path.duration == math.inf
    # 4 s there, 2 s of turning to the left, 4 s back, 2 s of turning
    for t, pose, twist, distance in [
        (3.0, (1.0, 0.0, 0.0), (0.5, 0.0, 0.0), 1.0),
        (6.0, (2.0, 0.0, math.pi / 2), (0.0, 0.0, math.pi / 2), 2.0),
        (8.0, (1.5, 0.0, math.pi), (0.5, 0.0, 0.0), 2.5),
        (12.0, (0.0, 0.0, -math.pi / 2), (0.0, 0.0, math.pi / 2), 4.0),
        (14.0, (0.5, 0.0, 0.0), (0.5, 0.0, 0.0), 4.5),
    ]:
        motion = path.at(t)
        # Sums of a few rounded numbers below 10.
        assert motion.pose == pytest.approx(pose, abs=1e-12)
        assert motion.twist == pytest.approx(twist, abs=1e-12)
        assert motion.distance == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("name", PATHS)
def test_twist_is_the_derivative_of_the_pose(name):
    path, dt = make_path(PATHS[name]), 1e-4
    jumps = {25.0, 25.0 + 10.0 * math.pi}  # of the U-track's yaw rate
    for k in range(300):
        t, gait = 0.0517 + 0.273 * k, Gait() if k % 2 else None  # nowhere within dt of a jump
        assert all(abs(t - jump) > dt for jump in jumps)
        now, measured, speed = differences(path, gait, t, dt)
        # waypoints: cubics between 50 poses a piece have the speed to 3e-5; others are exact
        assert now.twist == pytest.approx(measured, abs=5e-5)
        assert speed == pytest.approx(math.hypot(*path.at(t).twist[:2]), abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_lemniscate_has_its_known_length_and_curvature(side):
    curve = Lemniscate(2.0, side)
    half = 2.622057554292119  # the lemniscate constant: half the length at half width 1
    assert curve.at(half)[0] == pytest.approx((0.0, 0.0, -side * math.pi / 2), abs=1e-12)
    assert curve.at(2.0 * half)[0] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    pose, curvature = curve.at(half / 2)  # the far end of the first loop
    end = (math.sqrt(0.5), side * math.sqrt(0.5), side * 0.75 * math.pi)
    assert pose == pytest.approx(end, abs=1e-12)
    assert curvature == pytest.approx(side * 3.0, abs=1e-9)


def test_gait_sways_each_stride_and_pulses_each_step():
    path = make_path(Straight(speed_m_s=1.0))
    steps = [with_gait(path.at(t), GAIT) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
    # Left over one foot, right over the other; fastest as the feet change.
    assert [m.pose.y for m in steps] == pytest.approx([0.0, 0.03, 0.0, -0.03, 0.0], abs=1e-12)
    assert [m.twist.x for m in steps] == pytest.approx([1.1, 0.9, 1.1, 0.9, 1.1])
    assert [m.pose.x for m in steps] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_a_hard_stop_covers_v_squared_over_2a():
    walk = TwistWalk(scripted([(3.0, Twist2D(1.8, 0.0, 0.0))], 6.0, 12.0))
    speeding_up, at_speed = walk.at(0.3).pose.x, walk.at(3.0).pose.x
    # a ramp ends within a cell of when it should
    assert speeding_up == pytest.approx(1.8**2 / 12.0, abs=1.8 * CELL_S)
    assert walk.duration == pytest.approx(3.3, abs=CELL_S)
    assert walk.at(10.0).pose.x - at_speed == pytest.approx(1.8**2 / 12.0, abs=1e-9)
    assert walk.at(10.0).twist == Twist2D()


@given(
    st.lists(
        st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)),
        min_size=2,
        max_size=8,
        unique_by=lambda p: (round(p[0], 1), round(p[1], 1)),
    )
)
def test_any_waypoints_are_walked_or_refused(points):
    try:
        path = make_path(Waypoints(points_m=tuple(points), speed_m_s=1.0))
    except ConfigError as error:
        assert "too sharply" in str(error)  # noqa: PT017 - most points are walked
        return
    assert path.duration >= math.dist(points[0], points[-1]) - 1e-6
    ends = path.at(0.0).pose[:2], path.at(path.duration).pose[:2]
    assert ends[0] == pytest.approx(points[0], abs=1e-9)
    assert ends[1] == pytest.approx(points[-1], abs=1e-9)


WALKERS = range(8)
SECONDS = 40.0


def motions(number, start_after_s=0.0):
    path = make_path(Wander(number=number, duration_s=SECONDS, start_after_s=start_after_s))
    return [path.at(start_after_s + 0.1 * k) for k in range(round(SECONDS / 0.1))]


@pytest.fixture(scope="module")
def walks():
    return [motions(number) for number in WALKERS]


def test_a_number_is_a_walker(walks):
    assert motions(3) == walks[3]
    # the start shifts the cells of 5 ms by its rounding
    assert motions(3, 1.0)[-1].pose == pytest.approx(walks[3][-1].pose, abs=1e-3)
    assert len({walk[-1].pose for walk in walks}) == len(WALKERS)
