"""The planner in the whole system: physics, a lidar and a camera."""

import math

import numpy as np
import pytest
from follower.rooms import DRIVE
from harness import SCENARIOS, load_robot
from mecazen import keys
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.drive import LimiterState, MotionLimits, axis_limits, limit_twist
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.wheels import MecanumKinematics
from mecazen_follower.planner.mppi import roll
from mecazen_tools.observe import observe
from mecazen_tools.simulate import simulate

SIDE = (
    "start={ y_m = 1.2, yaw_deg = -90.0 }",
    "target.path={ kind = 'straight', speed_m_s = 0.6, length_m = 20.0 }",
    "follower.view='side_left'",
)
WALLS = (
    "{ kind = 'box', size_m = [2.5, 0.1, 1.0], position_m = [3.75, 0.9] }",
    "{ kind = 'box', size_m = [2.5, 0.1, 1.0], position_m = [3.75, -0.9] }",
)


def test_in_open_space_the_trajectory_is_the_followers_to_the_bit():
    def run(*settings):
        lidar = ("sim.duration_s=3.0", 'sensor.also=["lidar"]')
        scenario = load_scenario(SCENARIOS / "back.toml", parse_settings((*lidar, *settings)))
        return simulate(scenario, "back")[0].trajectory_sha256

    assert run("follower.planner={}") == run()


def test_in_a_corridor_the_robot_goes_behind_and_then_back_to_the_side():
    settings = (
        *SIDE,
        "sim.duration_s=12.5",
        f"world.obstacles=[{', '.join(WALLS)}]",
        "follower.planner={ samples = 300 }",
    )
    scenario = load_scenario(SCENARIOS / "senses.toml", parse_settings(settings))
    truth, states = observe(scenario, keys.GROUND_TRUTH, keys.FOLLOWER_STATE).samples.values()
    robots = [odom.pose.pose.to_planar() for odom in truth]
    length, width = scenario.robot.footprint
    inside = [robot for robot in robots if 2.5 < robot.x < 5.0]
    assert inside
    for robot in inside:  # the walls' faces are at ±0.85 m
        reach = length * abs(math.sin(robot.yaw)) + width * abs(math.cos(robot.yaw))
        assert abs(robot.y) + reach < 0.85
    plans = {state.plan for state in states}
    assert {"open", "avoiding", "gave_up_bearing"} <= plans
    assert any(state.plan_reason.startswith("an obstacle is in the way") for state in states)
    assert states[-1].plan == "open"
    assert max(state.last_seen_s for state in states) < 0.5
    assert math.degrees(states[-1].bearing_error) == pytest.approx(0.0, abs=10.0)


@pytest.mark.parametrize("deceleration", [None, 4.0])
def test_a_rollout_goes_where_the_controllers_limits_let_the_robot_go(deceleration):
    linear = LinearLimits(max_deceleration_m_s2=deceleration)
    limits = axis_limits(AxisLimits(linear, linear, AngularLimits(max_acceleration_rad_s2=4.0)))
    drive = DRIVE._replace(axes=limits)
    kinematics = MecanumKinematics.from_robot(load_robot())
    steps, dt, tick = 8, 0.125, 0.00125
    # along odom's axes: off at full speed, sideways as well, then to rest
    commands = np.array([[1.5, 0.0, 0.0]] * 3 + [[0.3, 0.9, 0.8]] * 3 + [[0.0, 0.0, 0.0]] * 2)
    able = MotionLimits(drive, 5.0, dt, 1)
    way = roll(0.3, Twist2D(0.2), steps, able, lambda k, *_: commands[k, :, None])

    state = (LimiterState(0.2), LimiterState(), LimiterState())
    robot = Pose2D(yaw=0.3)
    for k, (vx, vy, turn) in enumerate(commands):
        for _ in range(round(dt / tick)):
            c, s = math.cos(robot.yaw), math.sin(robot.yaw)
            wanted = Twist2D(c * vx + s * vy, c * vy - s * vx, turn)
            state = limit_twist(state, wanted, limits, tick)
            speeds = kinematics.inverse(Twist2D(*(axis.velocity for axis in state)))
            robot = robot.integrate(kinematics.forward(speeds.desaturate(40.0)), tick)
        # the controller turns the command as the robot turns, a rollout once a step
        assert (way.x[k, 0], way.y[k, 0]) == pytest.approx((robot.x, robot.y), abs=0.03)
        assert math.atan2(way.s[k, 0], way.c[k, 0]) == pytest.approx(robot.yaw, abs=0.05)
