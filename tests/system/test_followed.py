"""The follower in whole runs: it catches up, withstands faults of its sensor, and plans."""

import math
import re

import numpy as np
import pytest
from harness import SCENARIOS, load_robot, mecazen, options
from mecazen import keys
from mecazen.config import Scenario
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.drive import Drive, LimiterState, MotionLimits, axis_limits, limit_twist
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario
from mecazen.wheels import MecanumKinematics
from mecazen_follower.planner.mppi import roll
from mecazen_recorder.reader import Recording
from mecazen_tools.observe import observe
from mecazen_tools.recorded import trajectory_of
from mecazen_tools.run_figure import courses, draw
from mecazen_tools.table import deviations, first_motion

PLANE = {"programs.physics": "mecazen_tools.plane:Plane"}
DURATION_S = 10.0
REACTION_S = 0.06
"""A frame of 40 ms, in which the person has moved for the first time, and a tick each for the
command and for the wheels."""
FAULTS = {
    "outliers": {"outlier_probability": 0.02},
    "flips": {"flip_probability": 0.03},
    "reported noise halved": {"reported_noise_ratio": 0.5},
    "reported noise doubled": {"reported_noise_ratio": 2.0},
    "second person": {"other_m": 1.0, "ids": True},
    "stand-in": {"other_m": 1.0, "other_seen": False, "stand_ins_s": [[5.0, 7.0]]},
    "latency that is not reported": {"unsaid_latency_s": 0.1},
}


def distance_errors(settings):
    """Return the errors of the distance from the first motion on [m]."""
    scenario = load_scenario(SCENARIOS / "back.toml", settings)
    table = observe(scenario).table
    return abs(deviations(table, scenario.follower.standoff)[0, first_motion(table) :])


def least_error(speed: float, reaction_s: float, dt: float = 1e-4) -> float:
    """Return the least mean distance error [m] behind a person who walks off at `speed` [m/s].

    The robot stands until it has seen the person walk, speeds up at its limit, drives at most
    at the rims' speed, and brakes at its limit so that it has the person's speed at its place:
    nothing within the limits is faster.
    """
    limits = AxisLimits().x
    acceleration, fastest = limits.max_acceleration_m_s2, limits.max_velocity_m_s
    velocity = behind = total = 0.0
    braking = False
    for step in range(round(DURATION_S / dt)):
        closing = velocity - speed
        braking = braking or (closing > 0.0 and behind <= closing**2 / (2.0 * acceleration))
        if braking:
            velocity = max(speed, velocity - acceleration * dt)
        elif step * dt >= reaction_s:
            velocity = min(fastest, velocity + acceleration * dt)
        behind += (speed - velocity) * dt
        total += abs(behind) * dt
    return total / DURATION_S


@pytest.mark.parametrize("speed", [1.0, 1.6])
def test_catching_up_costs_little_more_than_the_least(speed):
    settings = {
        "sim.duration_s": DURATION_S,
        "target.path": {"kind": "straight", "speed_m_s": speed, "length_m": 30.0},
        "target.gait": {"sway_m": 0.0, "speed_ripple": 0.0},
        # the test judges the plan, not the effect of noise
        "sensor.position_std_m": 0.001,
        "sensor.yaw_std_deg": 0.1,
    }
    error = distance_errors(settings).mean()
    assert least_error(speed, 0.0) < error < 1.1 * least_error(speed, REACTION_S)


@pytest.fixture(scope="module")
def with_fault():
    path = {"kind": "circle", "radius_m": 3.0, "speed_m_s": 0.5, "start_after_s": 0.5}
    walk = PLANE | {"sim.duration_s": 12.0, "target.path": path}
    return lambda faults: distance_errors(walk | {"sensor.faults": faults})


@pytest.fixture(scope="module")
def clean(with_fault):
    return with_fault({})


@pytest.mark.parametrize("fault", FAULTS)
def test_no_fault_costs_half_the_distance_error_more(fault, with_fault, clean):
    errors = with_fault(FAULTS[fault])
    assert errors.mean() < 1.5 * clean.mean()
    # nor is the robot drawn to where the person is not
    assert errors.max() < clean.max() + 0.15


def test_in_open_space_the_planner_changes_nothing():
    def run(settings):
        lidar = {"sim.duration_s": 3.0, "sensor.also": ["lidar"]}
        scenario = load_scenario(SCENARIOS / "back.toml", PLANE | lidar | settings)
        return observe(scenario).trajectory_sha256

    assert run({"follower.planner": {}}) == run({})


def test_in_a_corridor_the_robot_goes_behind_and_returns():
    walls = [
        {"kind": "box", "size_m": [2.5, 0.1, 1.0], "position_m": [3.75, y]} for y in (0.9, -0.9)
    ]
    settings = {
        "start": {"y_m": 1.2, "yaw_deg": -90.0},
        "target.path": {"kind": "straight", "speed_m_s": 0.6, "length_m": 20.0},
        "follower.view": "side_left",
        "sim.duration_s": 14.5,
        "world.obstacles": walls,
        "follower.planner": {"samples": 300},
    }
    scenario = load_scenario(SCENARIOS / "senses.toml", PLANE | settings)
    run = observe(scenario, keys.FOLLOWER_STATE)
    (states,) = run.samples.values()
    x, y, yaw = run.table.poses("robot")
    length, width = scenario.robot.footprint
    reach = abs(y) + length * abs(np.sin(yaw)) + width * abs(np.cos(yaw))
    inside = (x > 2.5) & (x < 5.0)
    assert inside.any()
    assert reach[inside].max() < 0.85  # the walls' faces are at ±0.85 m
    assert {"open", "avoiding", "gave_up_bearing"} <= {state.plan for state in states}
    assert any(state.plan_reason.startswith("an obstacle is in the way") for state in states)
    assert states[-1].plan == "open"
    assert max(state.last_seen_s for state in states) < 0.5
    assert math.degrees(states[-1].bearing_error) == pytest.approx(0.0, abs=10.0)


@pytest.mark.parametrize("deceleration", [None, 4.0])
def test_a_rollout_keeps_to_the_limits_of_the_controller(deceleration):
    robot = load_robot()
    linear = LinearLimits(max_deceleration_m_s2=deceleration)
    limits = axis_limits(AxisLimits(linear, linear, AngularLimits(max_acceleration_rad_s2=4.0)))
    drive = Drive.from_scenario(Scenario(robot=robot))._replace(axes=limits)
    kinematics = MecanumKinematics.from_robot(robot)
    steps, dt, tick = 8, 0.125, 0.00125
    # along odom's axes: off at full speed, sideways as well, then to rest
    commands = np.array([[1.5, 0.0, 0.0]] * 3 + [[0.3, 0.9, 0.8]] * 3 + [[0.0, 0.0, 0.0]] * 2)
    motion = MotionLimits(drive, 5.0, dt, 1)
    path = roll(0.3, Twist2D(0.2), steps, motion, lambda k, *_: commands[k, :, None])

    state = (LimiterState(0.2), LimiterState(), LimiterState())
    pose = Pose2D(yaw=0.3)
    for k, (vx, vy, turn) in enumerate(commands):
        for _ in range(round(dt / tick)):
            c, s = math.cos(pose.yaw), math.sin(pose.yaw)
            command = Twist2D(c * vx + s * vy, c * vy - s * vx, turn)
            state = limit_twist(state, command, limits, tick)
            speeds = kinematics.inverse(Twist2D(*(axis.velocity for axis in state)))
            pose = pose.integrate(kinematics.forward(speeds.desaturate(40.0)), tick)
        # the controller turns the command as the robot turns, a rollout once a step
        assert (path.x[k, 0], path.y[k, 0]) == pytest.approx((pose.x, pose.y), abs=0.03)
        assert math.atan2(path.s[k, 0], path.c[k, 0]) == pytest.approx(pose.yaw, abs=0.05)


def test_a_loss_is_explained_at_load_in_the_scores_the_recording_and_the_picture(tmp_path):
    reason = "shoulders not in the camera's view"
    path = tmp_path / "run.mcap"
    settings = (
        "sensor.kind=body",
        "robot.camera.pitch_deg=0",
        *(f"{k}={v}" for k, v in PLANE.items()),
    )
    done = mecazen("simulate", "back", "--duration", "20", "--record", path, *options(settings))
    assert done.stderr.startswith(f"warning: follower.standoff_m = 1: {reason}; that takes ")
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("lost "))
    assert re.fullmatch(rf"lost \d+% of the time: {reason}", line)
    assert f"  robot: {line}\n" in mecazen("info", path).stdout
    run = trajectory_of(Recording(path))
    figure = draw(courses(run), run.scenario, "")
    assert figure.get_supxlabel() == line
    assert {"coasting", "lost"} <= {text.get_text() for text in figure.legends[0].get_texts()}
