"""The bound of the estimate of a random walker, against filterpy's filter of its linear part."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from mecazen.config import SensorConfig
from mecazen.config.people import Wander
from mecazen_experiments.limit import pose_covariances, target_covariances
from mecazen_people.wander import DIFFUSION, RELAXATION_1_S, walker
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


def test_a_better_sensor_has_a_lower_bound():
    path = Wander(number=NUMBER)
    better = SensorConfig(position_std_m=0.02, yaw_std_deg=5.0)
    low, high = (pose_covariances(path, sensor, 10.0) for sensor in (better, SENSOR))
    assert (np.linalg.eigvalsh(high - low) > -1e-12).all()
    assert (np.linalg.eigvalsh(high)[:, 0] > 0.0).all()
