"""Scores of runs that are made up, against figures worked out by hand, and of a real one."""

import math

import numpy as np
import pytest
from experiments.made_up import BACK, TICK_S, covariances, line, run, twist
from harness import SCENARIOS
from mecazen.geometry import Pose2D, Standoff
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.scores import SETTLING_S, nees, score
from mecazen_tools.simulate import simulate
from mecazen_tools.table import Poses, wrap

DISTANCES = [f"d_{measure}_m" for measure in ("err", "rms", "p95", "max")]
ANGLES = [f"theta_{measure}_deg" for measure in ("err", "rms", "p95", "max")]


def test_errors_of_0_to_100_cm_have_mean_rms_percentile_and_maximum():
    person = line(102)
    cm = np.clip(np.arange(102.0) - 1.0, 0.0, None)  # tick 0 is before the first motion
    cm[::2] *= -1.0
    robot = Poses(person.x - 1.0 - cm / 100.0, person.y, np.radians(cm))
    scores = score(run(102, target=person, robot=robot), BACK)
    rms = math.sqrt(sum(k * k for k in range(101)) / 101)
    assert [scores[name] for name in ANGLES] == pytest.approx([50.0, rms, 95.0, 100.0])
    assert [100.0 * scores[name] for name in DISTANCES] == pytest.approx([50.0, rms, 95.0, 100.0])


def test_a_robot_that_lags_on_a_circle_is_off_by_the_chord():
    # both on a circle of 2 m about the origin, the robot 40° behind: the chord is
    # 2 r sin(20°), and makes an angle of 20° with the tangent at the person
    radius, rate, lag = 2.0, 0.1, math.radians(40.0)
    ticks = 1000
    angle = rate * TICK_S * np.arange(ticks)

    def at(angle):
        return Poses(radius * np.sin(angle), -radius * np.cos(angle), angle)

    moving = twist("robot", radius * rate, 0.0, rate)
    scores = score(run(ticks, target=at(angle), robot=at(angle - lag), **moving), BACK)
    chord = 2.0 * radius * math.sin(lag / 2)
    assert scores["d_err_m"] == pytest.approx(chord - 1.0)
    assert scores["min_distance_m"] == pytest.approx(chord)
    assert scores["theta_err_deg"] == pytest.approx(40.0)
    assert scores["bearing_err_deg"] == pytest.approx(20.0)
    # by the law of cosines
    square = chord**2 + 1.0 - 2.0 * chord * math.cos(lag / 2)
    assert scores["goal_err_m"] == pytest.approx(math.sqrt(square))
    # differences over a tick: each turns a vector into its chord, 2 sin(turn / 2) as long
    turn = 2.0 * math.sin(rate * TICK_S / 2) / TICK_S
    assert scores["acceleration_rms_m_s2"] == pytest.approx(radius * rate * turn)
    assert scores["jerk_rms_m_s3"] == pytest.approx(radius * rate * turn**2)


def test_the_measures_begin_with_the_first_motion_and_settle_5_s_later():
    first, ticks = 100, 1100
    tick = np.arange(ticks)
    x = 0.002 * np.clip(tick - first + 1, 0, None)
    off = np.select([tick < first, tick < first + 500], [9.0, 0.4], default=0.2)
    table = run(ticks, target=(x, 0.0, 0.0), robot=(x - 1.0 - off, 0.0, 0.0))
    assert score(table, BACK)["d_err_m"] == pytest.approx(0.3)  # 500 ticks of each
    assert score(table, BACK)["d_max_m"] == pytest.approx(0.4)
    assert score(table, BACK, SETTLING_S)["d_max_m"] == pytest.approx(0.2)


@pytest.mark.parametrize("target", [(), (1.0, 2.0, 3.0)], ids=["nobody", "standing"])
def test_without_a_person_who_moves_there_are_no_measures(target):
    table = run(100, robot=(0.0, 0.0, 0.0), target=target, **twist("robot", 0.0))
    assert {*score(table, BACK).values()} == {None}


@pytest.mark.parametrize("every", [1, 4])
def test_a_command_that_goes_to_and_fro_varies_by_each_step(every):
    ticks = 101  # the first motion is in tick 1; commands come in 4, 8, …, 100
    fro = np.arange(ticks) // every % 2 * np.where(np.arange(ticks) % every == 0, 1.0, np.nan)
    command = twist("cmd", 0.03 * fro, 0.04 * fro, 0.2 * fro)
    scores = score(run(ticks, target=line(ticks), robot=line(ticks), **command), BACK)
    assert scores["command_variation_m_s2"] == pytest.approx(0.05 / (every * TICK_S))
    assert scores["yaw_command_variation_rad_s2"] == pytest.approx(0.2 / (every * TICK_S))


def test_a_real_run_has_every_measure_and_those_of_the_simulator():
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(["sim.duration_s=8"]))
    _, trajectory = simulate(scenario, "back")
    scores, expected = score(trajectory.table(), BACK), trajectory.scores()
    # sums in another order: roundings of 1e-16 of 700 ticks
    assert scores["d_err_m"] == pytest.approx(expected.d_err_m, rel=1e-12)
    assert scores["theta_err_deg"] == pytest.approx(expected.theta_err_deg, rel=1e-12)
    assert scores.pop("theta_hardly_walking_deg") is None  # the person never slows down
    assert all(map(math.isfinite, scores.values()))


# --- estimation ----------------------------------------------------------------------------


def estimated(error, covariance, **columns):
    """Scores of a run whose odometry lies elsewhere, with errors [m, m, rad] along odom."""
    person = line(50, yaw=0.3)
    place = Standoff(1.3, math.radians(170.0), math.radians(10.0))
    robot = person.compose(place.goal(Pose2D()))
    odom = Poses(robot.y + 5.0, -robot.x, robot.yaw - math.pi / 2)
    truth = odom.compose(robot.between(person))
    x, y, turn = (true + off for true, off in zip(truth, error, strict=True))
    estimate = Poses(x, y, wrap(turn))
    poses = {"target": person, "robot": robot, "odom": odom, "estimate": estimate}
    return score(run(50, **poses, **covariances(covariance), **columns), BACK)


def test_an_estimate_is_compared_with_the_person_as_seen_from_the_robot():
    velocity = twist("estimate", 0.3, 0.4) | twist("target", 0.2)
    scores = estimated((0.03, -0.04, math.radians(-5.0)), np.eye(3), **velocity)
    assert scores["estimate_position_err_m"] == pytest.approx(0.05)
    assert scores["estimate_yaw_err_deg"] == pytest.approx(5.0)
    assert scores["estimate_speed_err_m_s"] == pytest.approx(0.3)  # 0.5 for 0.2


def test_nees_weighs_each_error_by_its_covariance():
    # 0.1² / 0.02 + 0.2² / 0.01 + 0.3² / 0.09
    diagonal = np.diag([0.02, 0.01, 0.09])
    assert estimated((0.1, 0.2, 0.3), diagonal)["nees"] == pytest.approx(0.5 + 4.0 + 1.0)
    # (0.1, 0.1) is an eigenvector of [[2, 1], [1, 2]] with the eigenvalue 3
    correlated = np.array([[0.02, 0.01, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 1.0]])
    assert estimated((0.1, 0.1, 0.0), correlated)["nees"] == pytest.approx(0.02 / 0.03)
    values = nees(np.ones((3, 2)), np.array([np.eye(2), np.zeros((2, 2)), np.diag([-1.0, -1.0])]))
    assert values[0] == pytest.approx(2.0)
    assert np.isnan(values[1:]).all()  # not positive definite


@pytest.mark.parametrize(("every", "lost", "coasting"), [(1, 10, 30), (4, 12, 28)])
def test_time_is_counted_by_the_newest_state_of_tracking(every, lost, coasting):
    tick = np.arange(101)
    tracking = np.select([tick > 90, tick > 60], ["lost", "coasting"], default="following")
    reported = np.where(tick % every == 0, tracking, "")
    scores = score(run(101, target=line(101), robot=line(101), tracking=reported), BACK)
    assert scores["lost_s"] == pytest.approx(lost * TICK_S)
    assert scores["coasting_s"] == pytest.approx(coasting * TICK_S)


def test_drift_is_the_share_of_the_path_by_which_the_odometry_is_off_at_the_end():
    ticks = 1001
    x = 0.01 * np.arange(ticks)  # after the first motion 9.99 m
    odom = (3.0, 0.98 * x, math.pi / 2)  # 2 % short, in its own frame
    scores = score(run(ticks, target=line(ticks), robot=(x, 0.0, 0.0), odom=odom), BACK)
    assert scores["odometry_drift_percent"] == pytest.approx(2.0)
    short = run(100, target=line(100), robot=(0.1 * x[:100], 0.0, 0.0), odom=(0.0,) * 3)
    assert score(short, BACK)["odometry_drift_percent"] is None  # of less than 10 cm
