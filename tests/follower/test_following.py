"""One tick after another: what takes time on the way to the wheels and from the sensor."""

from collections import deque

import numpy as np
import pytest
from mecazen.geometry import Pose2D, Twist2D
from mecazen_follower.config import FollowerConfig, PolarControl
from mecazen_follower.following import Following, Measurement

DT = 0.01
FRAME = 4
DELAY = 0.2
CONFIG = {
    "estimator": "ekf_ctrv",
    "estimator_params": {"acceleration_std_m_s2": 0.3, "yaw_acceleration_std_rad_s2": 1.0},
    "control": PolarControl(linear_gain_1_s=3.0, heading_gain_1_s=4.0),
}
CIRCLE = Twist2D(0.5, 0.0, 0.5)


def mean_error(*, response=0.0, told=0.0, robot_delay=0.0, sensor_delay=0.0, noise=0.0):
    """Return the mean distance from the goal [m] from 5 s to 20 s, with a person on a circle.

    Args:
        response: What the follower knows of the robot's delay [s].
        told: What it knows of the sensor's delay [s].
        robot_delay: Time from a command to the robot's motion [s].
        sensor_delay: Time from the capture of a frame to its arrival [s].
        noise: Standard deviation of what is seen [m, rad].
    """
    config = FollowerConfig(response_s=response, **CONFIG)
    following = Following(config, told)
    standoff = config.standoff
    rng = np.random.default_rng(6)
    covariance = np.eye(3) * max(noise, 0.01) ** 2
    person = Pose2D()
    robot = standoff.goal(person)
    commands = deque([Twist2D()] * round(robot_delay / DT))
    frames = deque([None] * round(sensor_delay / DT))
    errors = []
    for tick in range(round(20.0 / DT)):
        if tick:
            following.predict(DT)
        seen = Pose2D(*(np.array(person) + noise * rng.normal(size=3)).tolist())
        frames.append(Measurement(seen, covariance) if tick % FRAME == 0 else None)
        step = following.step(tick * DT, DT, robot, frames.popleft())
        commands.append(step.command)
        robot = robot.integrate(commands.popleft(), DT)
        person = person.integrate(CIRCLE, DT)
        errors.append(robot.distance(standoff.goal(person)))
    return np.mean(errors[round(5.0 / DT) :])


def test_a_robot_that_answers_late_to_a_high_gain_swings_unless_that_is_known():
    # heading: 4 per s for 0.5 s is beyond pi/2, where the loop of an integrator is unstable
    assert mean_error(robot_delay=0.5, noise=0.01) > 0.3
    assert mean_error(robot_delay=0.5, response=0.5, noise=0.01) < 0.05


def test_on_a_circle_a_late_answer_does_no_harm_since_the_command_stays_the_same():
    # what is left of the start after 5 s at 3 per s, and then some for the delay
    assert mean_error(robot_delay=DELAY) < 1e-3
    assert mean_error(robot_delay=DELAY, response=DELAY) < 1e-3


def test_on_a_circle_latency_is_made_up_for_wholly():
    # 0.5 m/s for 0.2 s are 0.1 m, and the goal 1 m behind swings by as much again
    late = mean_error(sensor_delay=DELAY)
    assert late == pytest.approx(0.1 * 2**0.5, rel=0.02)
    assert mean_error(sensor_delay=DELAY, told=DELAY) < 1e-3
