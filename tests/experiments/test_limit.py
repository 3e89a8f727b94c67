"""The limit of following: the bound of the estimate, and the oracle, which knows the person."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from harness import SCENARIOS
from mecazen.config import SensorConfig
from mecazen.config.people import Wander
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.limit import ORACLE, pose_covariances, target_covariances
from mecazen_people.wander import DIFFUSION, RELAXATION_1_S, walker
from mecazen_tools.simulate import simulate
from scipy.linalg import expm

NUMBER = 11
SENSOR = SensorConfig(position_std_m=0.05, yaw_std_deg=20.0)
FRAME_S = 1.0 / SENSOR.rate_hz


def test_the_bound_of_the_heading_is_the_variance_of_a_kalman_filter():
    # heading, turn rate and its target are a linear system of their own
    character, plan = walker(NUMBER)
    segment = next(plan)
    assert math.isinf(segment.period)
    frames = int(segment.duration / FRAME_S)
    rate = RELAXATION_1_S[2]
    kalman = KalmanFilter(3, 1)
    kalman.F = expm(np.array([[0, 1, 0], [0, -rate, rate], [0, 0, 0]]) * FRAME_S)
    kalman.H, kalman.R = np.eye(1, 3), math.radians(SENSOR.yaw_std_deg) ** 2
    spread = target_covariances(NUMBER)[segment.kind][2, 2]
    kalman.P = np.diag([1e6, 1e-8, spread])
    diffusion = np.diag([0.0, (character.evenness * DIFFUSION[2]) ** 2, 0.0])
    kalman.Q = kalman.F @ diffusion @ kalman.F.T * FRAME_S
    variances = []
    for _ in range(frames):
        kalman.update(np.zeros(1))
        variances.append(kalman.P[0, 0])
        kalman.predict()
    bound = pose_covariances(Wander(number=NUMBER), SENSOR, segment.duration)
    # its noise comes in 4 steps a frame: up to 2 % of it
    assert bound[:frames, 2, 2] == pytest.approx(np.array(variances), rel=0.02)


@pytest.mark.parametrize("scenario", ["back", "side"])
def test_the_error_of_an_oracle_is_that_of_the_robot(scenario):
    blind = parse_settings(
        ["sim.duration_s=4", "sensor.occlusions_s=[[0, 100]]"]
    )  # needs no sensor
    oracle, _ = simulate(load_scenario(SCENARIOS / f"{scenario}.toml", blind | ORACLE), scenario)
    # 0.2 m/s take 0.08 s at 2.5 m/s²: 8 mm at the start, and no more later
    assert oracle.d_err_m < 2e-3
    assert oracle.theta_err_deg < 0.1
