"""The table of a run and its scores, against figures worked out by hand."""

import hashlib
import math

import pytest
from harness import error_of, load_robot
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import FollowerConfig, RobotConfig, Scenario, SimConfig, StartConfig
from mecazen.errors import MecazenError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import FollowerState, Time, Twist, planar_odometry
from mecazen.wire import Stamp
from mecazen_tools.trajectory import COLUMNS, Scores, Trajectory

ALL = ("physics", "controller", "target", "follower")
MOTION = 0.5, 0.25, 1.0
COMMAND = 0.125, -0.5, 2.0


class Run:
    """A bus with the samples of a run, and its trajectory."""

    def __init__(self, ticks, services=ALL, robots=(), **settings):
        self.bus = Bus()
        sim = SimConfig(duration_s=0.01 * ticks)
        scenario = Scenario(load_robot(), services, seed=7, sim=sim, robots=robots, **settings)
        self.trajectory = Trajectory(self.bus, scenario)

    def put(self, topic, tick, message):
        self.bus.publisher(topic).put(message, Stamp(tick * 10_000_000, 1, 0))

    def pose(self, topic, tick, *pose):
        odometry = planar_odometry(Time(), "world", "base", Pose2D(*pose), Twist2D(*MOTION))
        self.put(topic, tick, odometry)

    def tick(self, tick, robot=(0.0, 0.0, 0.0), person=(1.0, 0.0, 0.0)):
        self.pose(keys.GROUND_TRUTH, tick, *robot)
        self.pose(keys.ODOM, tick, 0.5, 0.25, 0.0)
        self.pose(keys.TARGET_ODOM, tick, *person)
        self.put(keys.FOLLOWER_STATE, tick, FollowerState(tracking="waiting"))
        self.put(keys.CMD_VEL, tick, Twist.planar(Twist2D(*COMMAND)))


def test_csv_has_all_digits_and_empty_cells():
    values = 0.1 + 0.2, -0.0, 1e-5, -1.2345678901234567e-300, 5e-324, 1e16, 1.7e308
    run = Run(len(values))
    for tick, x in enumerate(values):
        run.tick(tick, robot=(x, 0.0, 0.0))
    header, *lines = run.trajectory.csv().decode().splitlines()
    assert header == ",".join(COLUMNS)
    assert [float(line.split(",")[1]) for line in lines] == list(values)
    motion = "0.5,0.25,1.0"
    others = f"0.5,0.25,0.0,1.0,0.0,0.0,{motion},{',' * 11},waiting,0.125,-0.5,2.0"
    assert lines[0] == f"0.0,0.30000000000000004,0.0,0.0,{motion},{others}"
    assert run.trajectory.sha256() == hashlib.sha256(run.trajectory.csv()).hexdigest()


def test_an_estimate_has_pose_motion_and_covariance():
    run = Run(1)
    covariance = tuple(float(10 * row + column) for row in range(6) for column in range(6))
    person = Pose2D(1.5, 2.5, 0.0), Twist2D(0.5, 0.0, 0.125)
    estimate = planar_odometry(Time(), "odom", "person", *person, covariance)
    run.put(keys.FOLLOWER_STATE, 0, FollowerState(estimate=(estimate,), tracking="following"))
    run.tick(0)
    row = dict(zip(COLUMNS, run.trajectory.rows()[0], strict=True))
    values = [value for name, value in row.items() if name.startswith("estimate")]
    assert values == [1.5, 2.5, 0.0, 0.5, 0.0, 0.125, 0.0, 1.0, 5.0, 11.0, 15.0, 55.0]
    assert row["tracking"] == "following"


def test_row_is_complete_with_all_samples():
    run = Run(2)
    assert (run.trajectory.done, run.trajectory.rows()) == (0, [])
    assert run.trajectory.scores() == Scores(None, None)
    run.tick(0)
    run.pose(keys.GROUND_TRUTH, 1, 0.0, 0.0, 0.0)
    assert (run.trajectory.done, run.trajectory.complete) == (1, False)
    reason = error_of(MecazenError, run.trajectory.refuse_incomplete)
    assert reason == "the run ended after 1 of 2 ticks"
    run.tick(1)
    assert (run.trajectory.done, run.trajectory.complete) == (2, True)


def test_heading_error_is_wrapped():
    run = Run(3, follower=FollowerConfig(view="side_left"))  # which wants -90°
    run.tick(0)
    run.tick(1, robot=(0.0, 0.0, math.radians(-170)), person=(1.1, 0.0, math.radians(90)))
    run.tick(2, robot=(0.0, 0.0, math.radians(-80)), person=(1.1, 0.0, 0.0))
    # 190° is 170°, and 10°; yaws pass through quaternions, each with a few roundings
    assert run.trajectory.scores().theta_err_deg == pytest.approx(90.0, rel=1e-13)


def test_standing_person_gives_no_scores():
    alone, standing = Run(1, services=("physics",)), Run(1)
    for run in (alone, standing):
        run.tick(0)
        assert run.trajectory.complete
        assert run.trajectory.scores() == Scores(None, None)
    assert alone.trajectory.rows() == [(0.0, 0.0, 0.0, 0.0, *MOTION, *[None] * 25)]


def test_each_of_several_robots_has_its_columns():
    robots = RobotConfig(name="one"), RobotConfig(name="two", start=StartConfig(y_m=2.0))
    run = Run(1, ("physics", "target"), robots)
    for name, x in (("one", 1.5), ("two", 3.0)):
        assert not run.trajectory.complete
        run.pose(keys.of_robot(keys.GROUND_TRUTH, name), 0, 0.0, 0.0, 0.0)
        run.pose(keys.of_robot(keys.TARGET_ODOM, name), 0, x, 0.0, 0.0)
    row = dict(zip(run.trajectory.columns, run.trajectory.rows()[0], strict=True))
    assert len(row) == 2 * (len(COLUMNS) - 1) + 1
    assert (row["one/target_x_m"], row["two/target_x_m"]) == (1.5, 3.0)
