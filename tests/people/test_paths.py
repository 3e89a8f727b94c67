"""Paths of a person: curves, scripts, commands, gait and recorded tracks, strictly read."""

import io
import math
import re
from contextlib import redirect_stdout
from itertools import pairwise

import numpy as np
import pytest
from harness import ROOT, error_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mecazen.config.people import (
    Circle,
    FigureOfEight,
    Gait,
    Recorded,
    Script,
    ScriptStep,
    Standing,
    Straight,
    UTrack,
    Wander,
    Waypoints,
)
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen_people.curves import lemniscate
from mecazen_people.dataset import read_track
from mecazen_people.motion import PersonPath, with_gait
from mecazen_people.paths import by_twists, make_path, scripted
from mecazen_people.recorded import MAX_YAW_RATE, STANDING_M_S, recorded_walk
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
    curve = lemniscate(2.0, side)
    half = 2.622057554292119  # the lemniscate constant: half the length at half width 1
    assert curve.at(half)[0] == pytest.approx((0.0, 0.0, -side * math.pi / 2), abs=1e-12)
    assert curve.at(2.0 * half)[0] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    pose, curvature = curve.at(half / 2)  # the far end of the first loop
    end = (math.sqrt(0.5), side * math.sqrt(0.5), side * 0.75 * math.pi)
    assert pose == pytest.approx(end, abs=1e-12)
    assert curvature == pytest.approx(side * 3.0, abs=1e-9)


def test_gait_sways_each_stride_and_pulses_each_step():
    path = make_path(Straight(speed_m_s=1.0))
    gait = Gait(sway_m=0.03, speed_ripple=0.1, step_length_m=0.5)
    steps = [with_gait(path.at(t), gait) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
    # Left over one foot, right over the other; fastest as the feet change.
    assert [m.pose.y for m in steps] == pytest.approx([0.0, 0.03, 0.0, -0.03, 0.0], abs=1e-12)
    assert [m.twist.x for m in steps] == pytest.approx([1.1, 0.9, 1.1, 0.9, 1.1])
    assert [m.pose.x for m in steps] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_a_hard_stop_covers_v_squared_over_2a():
    walk = by_twists(scripted([(3.0, Twist2D(1.8, 0.0, 0.0))], 6.0, 12.0))
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


def test_a_number_is_a_walker():
    def motions(number, start_after_s=0.0):
        path = make_path(Wander(number=number, duration_s=40.0, start_after_s=start_after_s))
        return [path.at(start_after_s + 0.1 * k) for k in range(400)]

    walks = [motions(number) for number in range(8)]
    assert motions(3) == walks[3]
    # the start shifts the cells of 5 ms by its rounding
    assert motions(3, 1.0)[-1].pose == pytest.approx(walks[3][-1].pose, abs=1e-3)
    assert len({walk[-1].pose for walk in walks}) == len(walks)


SMOOTHING_S = 0.8
WALKS = ROOT / "configs" / "walks"

# Between two knots of the heading a monotone cubic is at most 1.5 times as steep as its secant.
YAW_RATE_LIMIT = 1.5 * MAX_YAW_RATE


def line(t: float) -> tuple[float, float, float]:
    return t, 2.0 + 0.6 * t, 1.0 + 0.8 * t


def recorded(samples: list[tuple[float, float, float]]) -> PersonPath:
    return recorded_walk(np.array(samples), SMOOTHING_S)


def every(track: PersonPath, dt: float = 0.01) -> list[float]:
    return [k * dt for k in range(1, int(track.duration / dt))]


def test_steady_walk_is_a_steady_walk():
    track = recorded([line(0.4 * k) for k in range(20)])
    for t in (0.0, 0.1, 3.3, 7.6):
        pose, twist, distance = track.at(t)
        # Differences of integrals over up to 20 s: some rounding of 100.
        assert pose == pytest.approx((*line(t)[1:], math.atan2(0.8, 0.6)), abs=1e-9)
        assert twist == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
        assert distance == pytest.approx(t, abs=1e-9)


def test_jitter_does_not_turn_a_standing_person():
    jitter = [(0.02, 0.0), (-0.02, 0.01), (0.0, -0.02), (0.01, 0.02), (-0.01, 0.0)]
    standing = [(4.0 + 0.4 * k, 4.0 + jitter[k % 5][0], jitter[k % 5][1]) for k in range(50)]
    track = recorded([*((0.4 * k, 0.4 * k, 0.0) for k in range(10)), *standing])
    headings = {track.at(5.0 + 0.1 * k).pose.yaw for k in range(180)}
    assert len(headings) == 1


@settings(max_examples=50, deadline=None)  # building a track takes milliseconds
@given(
    st.lists(
        st.tuples(st.floats(0.05, 3.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
        min_size=1,
        max_size=15,
    )
)
def test_heading_of_any_track_is_continuous(steps):
    samples = [(0.0, 0.0, 0.0)]
    for dt, dx, dy in steps:
        t, x, y = samples[-1]
        samples.append((t + dt, x + dx, y + dy))
    track = recorded(samples)
    for t0, t1 in pairwise(every(track, 0.02)):
        before, after = track.at(t0), track.at(t1)
        turned = abs(wrap(after.pose.yaw - before.pose.yaw))
        assert turned <= YAW_RATE_LIMIT * 0.02 + 1e-9
        assert abs(after.twist.yaw) <= YAW_RATE_LIMIT + 1e-9
        assert after.distance >= before.distance - 1e-3  # cubics across a jump of speed


def test_recorded_person_moves_as_people_do():
    file = WALKS / "synthetic.csv"
    samples = read_track(file)
    track = recorded_walk(samples, SMOOTHING_S)
    first = samples[0, 0]
    off = [math.dist(track.at(t - first).pose[:2], (x, y)) for t, x, y in samples.tolist()]
    # The samples of tracked people are good to about a decimetre, and jump by five.
    assert max(off) < 0.25
    assert math.sqrt(sum(d * d for d in off) / len(off)) < 0.06
    assert max(off[0], off[-1]) < 1e-9
    sideways = 0.0
    for t in every(track):
        motion = track.at(t)
        speed = math.hypot(*motion.twist[:2])
        assert speed < 2.5  # the fastest first step in the recordings; the rest is below 2.2
        assert abs(motion.twist.yaw) <= YAW_RATE_LIMIT
        if speed < STANDING_M_S / 2:  # well away from where walking begins within a knot
            assert motion.twist.yaw == 0.0
        sideways += abs(motion.twist.y) * 0.01
    # While they turn to set off, and where they shuffle: below 0.2 m/s the heading is held.
    assert sideways < 0.1 * track.at(track.duration).distance
    path, dt = make_path(Recorded(file=file, x_m=1.0, yaw_deg=40.0, start_after_s=2.0)), 1e-5
    for k in range(300):
        t = 2.0 + (k + 0.5) / 300 * (path.duration - 2.0)
        now, measured, _ = differences(path, Gait(), t, dt)
        # Acceleration jumps at samples, yaw acceleration (up to 1000 rad/s²) at knots: at
        # worst one of them lies within dt.
        assert now.twist == pytest.approx(measured, abs=1e-2)


def test_synthetic_walk_is_what_its_readme_makes():
    program = re.search(r"```python\n(.*?)```", (WALKS / "README.md").read_text(), re.DOTALL)
    with redirect_stdout(io.StringIO()) as printed:
        exec(program[1], {})  # noqa: S102 - our own
    assert printed.getvalue() == (WALKS / "synthetic.csv").read_text()


def test_a_track_of_hours_or_of_two_people_is_refused(tmp_path):
    file = tmp_path / "walk.csv"
    for text, reason in (
        ("t_s,x_m,y_m\n0,0,0\n75600,1,0\n", "the times must span at most 14400 s, span 75600 s"),
        ("id,t_s,x,y\na,0,0,0\na,1,1,0\nb,0,0,0\nb,1,1,0\n", "has 2 people: `mecazen people"),
    ):
        file.write_text(text)
        assert reason in error_of(ConfigError, lambda: read_track(file))
