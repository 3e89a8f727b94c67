"""Scores of runs that are made up, against figures worked out by hand, and of a real one."""

import math

import numpy as np
import pytest
from experiments.made_up import BACK, TICK_S, beside, covariances, line, run, twist, whole
from harness import SCENARIOS
from mecazen.geometry import Standoff
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.scores import SETTLING_S, nees, score
from mecazen_tools.simulate import simulate
from mecazen_tools.table import Poses, Table, wrap
from scipy import stats

SIDE_LEFT = Standoff(1.0, math.pi / 2, -math.pi / 2)
SIDE_RIGHT = Standoff(1.0, -math.pi / 2, math.pi / 2)
DISTANCES = [f"d_{measure}_m" for measure in ("err", "rms", "p95", "max")]
ANGLES = [f"theta_{measure}_deg" for measure in ("err", "rms", "p95", "max")]


def each(found, measures):
    return [found[measure] for measure in measures]


# --- following -----------------------------------------------------------------------------


def test_a_constant_offset_is_mean_rms_percentile_and_maximum():
    person = line(100)
    found = whole(run(100, target=person, robot=beside(person, 1.1, 180.0, -3.0)))
    assert each(found, DISTANCES) == pytest.approx([0.1] * 4)
    assert each(found, ANGLES) == pytest.approx([3.0] * 4)
    assert found["bearing_err_deg"] == pytest.approx(0.0, abs=1e-9)
    assert found["goal_err_m"] == pytest.approx(0.1)
    assert found["min_distance_m"] == pytest.approx(1.1)


def test_of_errors_of_0_to_100_cm_to_both_sides_each_measure_is_its_own():
    person = line(102)
    cm = np.clip(np.arange(102.0) - 1.0, 0.0, None)  # tick 0 is before the first motion
    cm[::2] *= -1.0
    robot = Poses(person.x - 1.0 - cm / 100.0, person.y, np.radians(cm))
    found = whole(run(102, target=person, robot=robot))
    rms = math.sqrt(sum(k * k for k in range(101)) / 101)
    expected = [50.0, rms, 95.0, 100.0]
    assert each(found, ANGLES) == pytest.approx(expected)
    assert [100.0 * metres for metres in each(found, DISTANCES)] == pytest.approx(expected)


def test_a_robot_that_lags_on_a_circle_is_off_by_the_chord():
    # both on a circle of 2 m about the origin, the robot 40° behind: the chord is
    # 2 r sin(20°), and makes an angle of 20° with the tangent at the person
    radius, rate, lag = 2.0, 0.1, math.radians(40.0)
    ticks = 1000
    angle = rate * TICK_S * np.arange(ticks)

    def at(angle):
        return Poses(radius * np.sin(angle), -radius * np.cos(angle), angle)

    moving = twist("robot", radius * rate, 0.0, rate)
    found = whole(run(ticks, target=at(angle), robot=at(angle - lag), **moving))
    chord = 2.0 * radius * math.sin(lag / 2)
    assert found["d_err_m"] == pytest.approx(chord - 1.0)
    assert found["theta_err_deg"] == pytest.approx(40.0)
    assert found["bearing_err_deg"] == pytest.approx(20.0)
    # by the law of cosines
    square = chord**2 + 1.0 - 2.0 * chord * math.cos(lag / 2)
    assert found["goal_err_m"] == pytest.approx(math.sqrt(square))
    # differences over a tick: each turns a vector into its chord, 2 sin(turn / 2) as long
    turn = 2.0 * math.sin(rate * TICK_S / 2) / TICK_S
    assert found["acceleration_rms_m_s2"] == pytest.approx(radius * rate * turn)
    assert found["jerk_rms_m_s3"] == pytest.approx(radius * rate * turn**2)


@pytest.mark.parametrize("turned", [-1.0, 1.0])
def test_headings_on_both_sides_of_the_cut_are_near_each_other(turned):
    person = line(10, yaw=math.radians(turned * 179.0))
    robot = beside(person, 1.0, 180.0 + turned, turned * 2.0)
    assert abs(robot.yaw[0] - person.yaw[0]) > math.pi
    found = whole(run(10, target=person, robot=robot))
    assert found["theta_err_deg"] == pytest.approx(2.0)
    assert found["bearing_err_deg"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("standoff", "bearing_deg", "heading_deg"),
    [(SIDE_LEFT, 90.0, -90.0), (SIDE_RIGHT, -90.0, 90.0)],
)
def test_in_a_side_view_the_heading_has_a_sign(standoff, bearing_deg, heading_deg):
    person = line(10, yaw=2.5)
    right = run(10, target=person, robot=beside(person, 1.0, bearing_deg, heading_deg))
    assert whole(right, standoff)["theta_err_deg"] == pytest.approx(0.0, abs=1e-9)
    assert whole(right, standoff)["goal_err_m"] == pytest.approx(0.0, abs=1e-9)
    away = run(10, target=person, robot=beside(person, 1.0, bearing_deg, -heading_deg))
    assert whole(away, standoff)["theta_err_deg"] == pytest.approx(180.0)
    beyond = run(10, target=person, robot=beside(person, 1.0, bearing_deg, 7 / 3 * heading_deg))
    assert whole(beyond, standoff)["theta_err_deg"] == pytest.approx(120.0)
    other_side = run(10, target=person, robot=beside(person, 1.0, -bearing_deg, heading_deg))
    assert whole(other_side, standoff)["d_err_m"] == pytest.approx(0.0, abs=1e-9)
    assert whole(other_side, standoff)["bearing_err_deg"] == pytest.approx(180.0)
    assert whole(other_side, standoff)["goal_err_m"] == pytest.approx(2.0)


# --- the window ----------------------------------------------------------------------------


def late_walk(ticks, first):
    """A person who stands until the tick before `first`."""
    steps = np.clip(np.arange(ticks) - first + 1, 0, None)
    return Poses(0.002 * steps, np.zeros(ticks), np.zeros(ticks))


def test_the_measures_begin_with_the_first_motion_and_settle_5_s_later():
    first, ticks = 100, 1100
    person = late_walk(ticks, first)
    off = np.select(
        [np.arange(ticks) < first, np.arange(ticks) < first + 500], [9.0, 0.4], default=0.2
    )
    table = run(ticks, target=person, robot=(person.x - 1.0 - off, 0.0, 0.0))
    assert whole(table)["d_err_m"] == pytest.approx(0.3)  # 500 ticks of each
    assert whole(table)["d_max_m"] == pytest.approx(0.4)
    assert score(table, BACK, SETTLING_S)["d_max_m"] == pytest.approx(0.2)


def test_a_turn_on_the_spot_is_motion():
    person = Poses(np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 0.1]))
    found = whole(run(3, target=person, robot=(np.array([-9.0, -9.0, -1.0]), 0.0, 0.1)))
    assert found["d_err_m"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("target", [(), (1.0, 2.0, 3.0)], ids=["nobody", "standing"])
def test_without_a_person_who_moves_there_are_no_measures(target):
    table = run(100, robot=(0.0, 0.0, 0.0), target=target, **twist("robot", 0.0))
    assert {*score(table, BACK).values()} == {None}


def test_what_was_not_reported_has_no_measure():
    person = line(100)
    table = run(100, target=person, robot=person, **twist("robot", 0.0))
    assert {*score(table, BACK, SETTLING_S).values()} == {None}  # 1 s
    values = whole(table)
    reported = {name for name, value in values.items() if value is not None}
    of_robot_and_person = {"acceleration_rms_m_s2", "jerk_rms_m_s3", "bearing_err_deg"}
    measured = {"goal_err_m", "min_distance_m", *DISTANCES, *ANGLES, "theta_hardly_walking_deg"}
    assert reported == of_robot_and_person | measured


# --- smoothness ----------------------------------------------------------------------------


def test_of_a_steady_acceleration_there_is_no_jerk():
    person = line(100)
    speeding = twist("robot", 0.0, 0.5 * TICK_S * np.arange(100.0))
    found = whole(run(100, target=person, robot=person, **speeding))
    assert found["acceleration_rms_m_s2"] == pytest.approx(0.5)
    # the speed is rounded at 1e-16, and divided by the tick twice
    assert found["jerk_rms_m_s3"] == pytest.approx(0.0, abs=1e-11)


def test_a_twist_in_the_body_is_turned_to_world():
    # straight on in world while turning: no acceleration
    person = line(100)
    yaw = 0.05 * np.arange(100)
    straight = twist("robot", np.cos(yaw), -np.sin(yaw), 5.0)
    found = whole(run(100, target=person, robot=(person.x, person.y, yaw), **straight))
    assert found["acceleration_rms_m_s2"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("every", [1, 4])
def test_a_command_that_goes_to_and_fro_varies_by_each_step(every):
    ticks = 101  # the first motion is in tick 1; commands come in 4, 8, …, 100
    person = line(ticks)
    fro = np.arange(ticks) // every % 2
    reported = np.where(np.arange(ticks) % every == 0, 1.0, np.nan)
    command = twist("cmd", 0.03 * fro * reported, 0.04 * fro * reported, 0.2 * fro * reported)
    found = whole(run(ticks, target=person, robot=person, **command))
    assert found["command_variation_m_s2"] == pytest.approx(0.05 / (every * TICK_S))
    assert found["yaw_command_variation_rad_s2"] == pytest.approx(0.2 / (every * TICK_S))


# --- the whole -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real():
    """A real run of 8 s, and what the simulator itself says of it."""
    settings = ("sim.duration_s=8",)
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(settings))
    _, trajectory = simulate(scenario, "back")
    return Table.of(trajectory), trajectory.scores()


def test_the_published_measures_of_a_real_run_are_those_of_the_simulator(real):
    table, expected = real
    found = whole(table)
    # sums in another order: roundings of 1e-16 of 700 ticks
    assert found["d_err_m"] == pytest.approx(expected.d_err_m, rel=1e-12)
    assert found["theta_err_deg"] == pytest.approx(expected.theta_err_deg, rel=1e-12)


def test_a_real_run_has_every_measure(real):
    for after_s in (0.0, SETTLING_S):
        values = score(real[0], BACK, after_s)
        assert values.pop("theta_hardly_walking_deg") is None  # the person never slows down
        assert all(map(math.isfinite, values.values()))


# --- estimation ----------------------------------------------------------------------------


def placed(person, robot, odom):
    """The person in odom, as seen from the true robot."""
    return odom.compose(robot.between(person))


def estimated(ticks, error, covariance, yaw=0.3, **given):
    """A run whose odometry lies elsewhere than world, with errors [m, m, rad] along odom."""
    person = line(ticks, yaw=yaw)
    robot = beside(person, 1.3, 170.0, 10.0)
    odom = Poses(robot.y + 5.0, -robot.x, robot.yaw - math.pi / 2)
    truth = placed(person, robot, odom)
    x, y, turn = (true + off for true, off in zip(truth, error, strict=True))
    estimate = Poses(x, y, wrap(turn))
    poses = {"target": person, "robot": robot, "odom": odom, "estimate": estimate}
    return run(ticks, **poses, **covariances(covariance), **given)


def test_an_estimate_is_compared_with_the_person_as_seen_from_the_robot():
    velocity = twist("estimate", 0.3, 0.4) | twist("target", 0.2)
    table = estimated(50, (0.03, -0.04, math.radians(-5.0)), np.eye(3), **velocity)
    found = whole(table)
    assert found["estimate_position_err_m"] == pytest.approx(0.05)
    assert found["estimate_yaw_err_deg"] == pytest.approx(5.0)
    assert found["estimate_speed_err_m_s"] == pytest.approx(0.3)  # 0.5 for 0.2


def test_a_drift_of_the_odometry_is_no_error_of_the_estimate():
    ticks = 100
    person = line(ticks)
    robot = beside(person, 1.0, 180.0, 0.0)
    odom = Poses(1.5 * robot.x, robot.y + 0.1 * robot.x, robot.yaw + 0.2 * robot.x)
    poses = {"target": person, "robot": robot, "odom": odom}
    estimate = placed(person, robot, odom)
    found = whole(run(ticks, **poses, estimate=estimate, **covariances(np.eye(3))))
    assert found["estimate_position_err_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["estimate_yaw_err_deg"] == pytest.approx(0.0, abs=1e-12)


def test_nees_weighs_each_error_by_its_covariance():
    # 0.1² / 0.02 + 0.2² / 0.01 + 0.3² / 0.09
    diagonal = estimated(50, (0.1, 0.2, 0.3), np.diag([0.02, 0.01, 0.09]))
    assert whole(diagonal)["nees"] == pytest.approx(0.5 + 4.0 + 1.0)
    # (0.1, 0.1) is an eigenvector of [[2, 1], [1, 2]] with the eigenvalue 3, (0.1, -0.1) with 1
    correlated = np.array([[0.02, 0.01, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 1.0]])
    assert whole(estimated(50, (0.1, 0.1, 0.0), correlated))["nees"] == pytest.approx(0.02 / 0.03)
    assert whole(estimated(50, (0.1, -0.1, 0.0), correlated))["nees"] == pytest.approx(0.02 / 0.01)


# the heading of the person is on the cut in odom: half of the errors reach across it
@pytest.mark.parametrize("yaw", [0.3, -math.pi / 2])
def test_nees_of_errors_drawn_from_their_covariance_is_3(yaw):
    ticks = 2001
    root = np.array([[0.05, 0.0, 0.0], [0.02, 0.04, 0.0], [-0.03, 0.01, 0.08]])
    errors = root @ np.random.default_rng(1).standard_normal((3, ticks))
    found = whole(estimated(ticks, errors, root @ root.T, yaw=yaw))
    # the sum of n values of chi-square with 3 degrees of freedom is one with 3 n
    n = ticks - 1
    low, high = stats.chi2.ppf([0.001, 0.999], 3 * n) / n
    assert low < found["nees"] < high
    # a percentile of n values has the deviation sqrt(p (1 - p) / n) / density
    p95 = stats.chi2.ppf(0.95, 3)
    deviation = math.sqrt(0.95 * 0.05 / n) / stats.chi2.pdf(p95, 3)
    assert found["nees_p95"] == pytest.approx(p95, abs=3 * deviation)


def test_ticks_without_an_estimate_are_left_out():
    ticks = 101
    known = np.arange(ticks) >= 51
    error = np.where(known, 0.1, np.nan), np.where(known, 0.0, np.nan), np.where(known, 0.0, np.nan)
    covariance = np.where(known[:, None, None], 0.01 * np.eye(3), np.nan)
    found = whole(estimated(ticks, error, covariance))
    assert found["estimate_position_err_m"] == pytest.approx(0.1)
    assert found["nees"] == pytest.approx(1.0)


def test_nees_is_said_only_where_the_covariance_is_positive_definite():
    good, none, saddle = np.eye(2), np.zeros((2, 2)), np.diag([-1.0, -1.0])
    found = nees(np.ones((3, 2)), np.array([good, none, saddle]))
    assert found[0] == pytest.approx(2.0)
    assert np.isnan(found[1:]).all()


# --- tracking and odometry -----------------------------------------------------------------


@pytest.mark.parametrize(("every", "lost", "coasting"), [(1, 10, 30), (4, 12, 28)])
def test_time_is_counted_by_the_newest_state_of_tracking(every, lost, coasting):
    tick = np.arange(101)
    tracking = np.select([tick > 90, tick > 60], ["lost", "coasting"], default="following")
    person = line(101)
    reported = np.where(tick % every == 0, tracking, "")
    found = whole(run(101, target=person, robot=person, tracking=reported))
    assert found["lost_s"] == pytest.approx(lost * TICK_S)
    assert found["coasting_s"] == pytest.approx(coasting * TICK_S)


def test_drift_is_the_share_of_the_path_by_which_the_odometry_is_off_at_the_end():
    ticks = 1001
    way = 0.01 * np.arange(ticks)  # after the first motion 9.99 m
    odom = (3.0, 0.98 * way, math.pi / 2)  # 2 % short, in a frame of its own
    found = whole(run(ticks, target=line(ticks), robot=(way, 0.0, 0.0), odom=odom))
    assert found["odometry_drift_percent"] == pytest.approx(2.0)
    near = whole(run(100, target=line(100), robot=(0.1 * way[:100], 0.0, 0.0), odom=(0.0,) * 3))
    assert near["odometry_drift_percent"] is None  # of less than 10 cm
