"""The table of a run and its scores, against figures worked out by hand."""

import hashlib
import math

import pytest
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.geometry import Pose2D, Standoff, Twist2D
from mecazen.messages import FollowerState, Time, Twist, planar_odometry
from mecazen.wire import Stamp
from mecazen_tools.trajectory import COLUMNS, Scores, Trajectory
from tools.runs import TICK_NS, Run

BEHIND = Standoff(1.0, math.pi, 0.0)


def test_a_row_holds_time_poses_and_command_in_the_order_of_the_columns():
    run = Run(1)
    run.tick(0, robot=(1.0, 2.0, 0.0), person=(3.0, 4.0, 0.0))
    assert run.trajectory.rows() == [
        (
            0.0,
            *(1.0, 2.0, 0.0, 0.5, 0.25, 1.0),
            *(0.5, 0.25, 0.0),
            *(3.0, 4.0, 0.0, 0.5, 0.25, 1.0),
            *[None] * 12,
            "waiting",
            *(0.125, -0.5, 2.0),
        )
    ]
    assert len(COLUMNS) == len(run.trajectory.rows()[0])


def test_the_csv_has_every_digit_and_nothing_where_nothing_is():
    run = Run(2)
    run.tick(0, robot=(0.1 + 0.2, -0.0, 0.0))
    run.tick(1)
    moving = "0.5,0.25,1.0"
    rest = f"0.5,0.25,0.0,1.0,0.0,0.0,{moving},{',' * 11},waiting,0.125,-0.5,2.0"
    assert run.trajectory.csv().decode().splitlines() == [
        "t_s,robot_x_m,robot_y_m,robot_yaw_rad,robot_vx_m_s,robot_vy_m_s,robot_yaw_rate_rad_s,"
        "odom_x_m,odom_y_m,odom_yaw_rad,"
        "target_x_m,target_y_m,target_yaw_rad,target_vx_m_s,target_vy_m_s,"
        "target_yaw_rate_rad_s,"
        "estimate_x_m,estimate_y_m,estimate_yaw_rad,estimate_vx_m_s,estimate_vy_m_s,"
        "estimate_yaw_rate_rad_s,estimate_xx_m2,estimate_xy_m2,estimate_xyaw_m_rad,"
        "estimate_yy_m2,estimate_yyaw_m_rad,estimate_yawyaw_rad2,tracking,"
        "cmd_vx_m_s,cmd_vy_m_s,cmd_yaw_rate_rad_s",
        f"0.0,0.30000000000000004,-0.0,0.0,{moving},{rest}",
        f"0.01,0.0,0.0,0.0,{moving},{rest}",
    ]


@pytest.mark.parametrize("x", [1e-5, -1.2345678901234567e-300, 5e-324, 1e16, 1.7e308, 2.0 / 3.0])
def test_numbers_of_any_size_come_back_from_the_csv(x):
    run = Run(2)
    run.tick(0, robot=(x, 0.0, 0.0))
    run.tick(1)
    cells = [line.split(",") for line in run.trajectory.csv().decode().splitlines()[1:]]
    assert [float(row[1]) for row in cells] == [x, 0.0]
    assert {len(row) for row in cells} == {len(COLUMNS)}


def test_an_estimate_is_written_where_there_is_one():
    run = Run(1)
    covariance = tuple(float(10 * row + column) for row in range(6) for column in range(6))
    person = Pose2D(1.5, 2.5, 0.0), Twist2D(0.5, 0.0, 0.125)
    estimate = planar_odometry(Time(), "odom", "person", *person, covariance)
    run.put(keys.FOLLOWER_STATE, 0, FollowerState(estimate=(estimate,), tracking="following"))
    run.tick(0)
    row = dict(zip(COLUMNS, run.trajectory.rows()[0], strict=True))
    told = {name: value for name, value in row.items() if name.startswith("estimate")}
    assert list(told.values()) == [1.5, 2.5, 0.0, 0.5, 0.0, 0.125, 0.0, 1.0, 5.0, 11.0, 15.0, 55.0]
    assert row["tracking"] == "following"


def test_the_hash_is_that_of_the_csv_and_tells_the_last_bit():
    runs = []
    for x in (0.3, math.nextafter(0.3, 1.0), 0.3):
        run = Run(1)
        run.tick(0, robot=(x, 0.0, 0.0))
        runs.append(run.trajectory)
    first, off, same = (run.sha256() for run in runs)
    assert first == same != off
    assert first == hashlib.sha256(runs[0].csv()).hexdigest()


def test_columns_of_who_does_not_take_part_stay_empty():
    run = Run(1, services=("physics",))
    run.tick(0, robot=(1.0, 2.0, 0.0))
    assert run.trajectory.rows() == [(0.0, 1.0, 2.0, 0.0, 0.5, 0.25, 1.0, *[None] * 25)]
    assert run.trajectory.complete


def test_a_run_is_complete_when_every_column_is():
    run = Run(2)
    run.tick(0)
    assert (run.trajectory.done, run.trajectory.complete) == (1, False)
    run.pose(keys.GROUND_TRUTH, 1, 0.0, 0.0, 0.0)
    assert (run.trajectory.done, run.trajectory.complete) == (1, False)
    run.tick(1)
    assert (run.trajectory.done, run.trajectory.complete) == (2, True)


def test_a_run_that_has_not_begun_has_no_rows_and_no_scores():
    run = Run(2)
    assert run.trajectory.rows() == []
    assert run.trajectory.scores(BEHIND) == Scores(None, None)
    assert run.trajectory.csv().count(b"\n") == 1


def test_the_first_sample_of_a_tick_counts_and_one_without_a_stamp_does_not():
    run = Run(1)
    run.bus.put_bytes("cmd_vel", b'{"linear":{"x":9.0}}')
    run.tick(0)
    run.put(keys.CMD_VEL, 0, Twist())
    assert run.trajectory.rows()[0][-3:] == (0.125, -0.5, 2.0)


def test_the_distance_error_is_the_mean_of_what_the_distance_is_off():
    run = Run(4)
    for tick, person in enumerate([(1.0, 0.0), (3.0, 4.0), (0.0, 0.5), (-1.0, 0.0)]):
        run.tick(tick, person=(*person, 0.0))
    # from the first motion on, distances 5, 0.5 and 1 where 1 is wanted: 4, 0.5 and 0
    assert run.trajectory.scores(BEHIND).d_err_m == 1.5


def test_the_heading_error_is_the_mean_of_the_wrapped_difference():
    run = Run(3)
    run.tick(0)
    run.tick(1, robot=(0.0, 0.0, math.radians(170)), person=(1.1, 0.0, math.radians(-170)))
    run.tick(2, robot=(0.0, 0.0, math.radians(10)), person=(1.1, 0.0, 0.0))
    # 20° the short way, and 10°; yaws pass through quaternions, each with a few roundings
    assert run.trajectory.scores(BEHIND).theta_err_deg == pytest.approx(15.0, rel=1e-13)


def test_the_heading_error_is_from_the_heading_that_is_wanted():
    run = Run(2)
    run.tick(0)
    run.tick(1, robot=(0.0, 0.0, math.radians(-170)), person=(1.0, 0.0, math.radians(90)))
    # the robot's heading is 100° ahead of the person's where -90° is wanted: 190° is 170°
    scores = run.trajectory.scores(Standoff(1.0, math.pi / 2, -math.pi / 2))
    assert scores.theta_err_deg == pytest.approx(170.0, rel=1e-13)


def test_without_a_person_or_with_one_who_stands_there_are_no_scores():
    alone = Run(1, services=("physics", "controller"))
    alone.pose(keys.GROUND_TRUTH, 0, 0.0, 0.0, 0.0)
    alone.pose(keys.ODOM, 0, 0.0, 0.0, 0.0)
    standing = Run(2)
    standing.tick(0)
    standing.tick(1)
    for run in (alone, standing):
        assert run.trajectory.complete
        assert run.trajectory.scores(BEHIND) == Scores(None, None)


def test_of_several_robots_each_has_its_columns_and_scores_and_all_make_the_hash():
    bus = LocalBus()
    trajectory = Trajectory(bus, TICK_NS, 1, ("physics", "target"), {"one": 1, "two": 1})
    for name, gap in (("one", 1.5), ("two", 3.0)):
        for topic, x in ((keys.GROUND_TRUTH, 0.0), (keys.TARGET_ODOM, gap)):
            odometry = planar_odometry(Time(), "world", "base", Pose2D(x=x), Twist2D())
            assert not trajectory.complete
            bus.publisher(keys.of_robot(topic, name)).put(odometry, Stamp(0, 1, 0))
    assert trajectory.complete
    row = dict(zip(trajectory.columns, trajectory.rows()[0], strict=True))
    assert len(row) == 2 * (len(COLUMNS) - 1) + 1
    assert (row["one/target_x_m"], row["two/target_x_m"]) == (1.5, 3.0)
    assert trajectory.csv().decode().startswith("t_s,one/robot_x_m,")
    assert trajectory.sha256() == hashlib.sha256(trajectory.csv()).hexdigest()
