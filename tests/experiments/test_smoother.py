"""The smoother against what it must be: right without noise, and better than its filter."""

import math

import numpy as np
import pytest
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen_experiments.smoother import LEVELS, Sight, least_errors, smooth
from mecazen_follower.estimators import make_estimator
from mecazen_tools.table import Poses

RATE = 25.0
STD = np.array([0.05, 0.05, 0.2])
WALKS = (0.02, 0.001, 0.0, 0.1, 0.1)


def walk(seconds, twist):
    """Return the poses of a walk whose twist is a function of time, at each frame."""
    poses = [Pose2D(1.0, -2.0, 3.0)]
    for frame in range(round(seconds * RATE) - 1):
        poses.append(poses[-1].integrate(twist(frame / RATE), 1.0 / RATE))
    return poses


def seen(poses, std, seed=1):
    noise = np.random.default_rng(seed).normal(size=(len(poses), 3)) * std
    covariance = np.diag(np.square(np.maximum(std, 1e-6)))
    return [
        Sight(i / RATE, Pose2D(*(np.array(pose) + error).tolist()), covariance)
        for i, (pose, error) in enumerate(zip(poses, noise, strict=True))
    ]


def turning(time):
    return Twist2D(0.5, 0.0, 0.4 if 4.0 < time < 8.0 else 0.0)


def test_what_is_seen_without_noise_is_kept_across_the_wrap():
    poses = walk(6.0, lambda _: Twist2D(0.5, 0.0, 0.4))
    states = smooth(seen(poses, np.zeros(3)), WALKS)
    for state, pose in zip(states, poses, strict=True):
        # seen to a micrometre; a model that is not quite the walk moves it by less
        assert state[:2] == pytest.approx(pose[:2], abs=1e-5)
        assert wrap(state[2] - pose.yaw) == pytest.approx(0.0, abs=1e-5)


def test_the_last_state_is_the_filters():
    sights = seen(walk(8.0, turning), STD)
    params = {
        "sway_m_sqrt_m": WALKS[0],
        "acceleration_std_m_s2": WALKS[3],
        "yaw_acceleration_std_rad_s2": WALKS[4],
    }
    estimator = make_estimator("ekf_ctrv", params)
    for sight in sights:
        estimator.predict(1.0 / RATE)
        estimator.update(sight.pose, sight.covariance)
    last = smooth(sights, WALKS)[-1]
    # the same arithmetic but for the tiny variance that the filter adds to a sensor's
    assert last[:2] == pytest.approx(estimator.estimate.pose[:2], abs=1e-8)
    assert wrap(last[2] - estimator.estimate.pose.yaw) == pytest.approx(0.0, abs=1e-8)


def test_it_knows_more_than_its_filter():
    poses = walk(12.0, turning)
    smoothed, filtered = [], []
    for seed in range(5):
        sights = seen(poses, STD, seed)
        states = smooth(sights, WALKS)
        smoothed.append(_yaw_error(states[:, 2], poses))
        ends = [smooth(sights[:end], WALKS)[-1, 2] for end in range(1, len(sights) + 1, 10)]
        filtered.append(_yaw_error(ends, poses[::10]))
    # with as much data ahead as behind, about half the error; 0.7 leaves room for five walks
    assert np.mean(smoothed) < 0.7 * np.mean(filtered)


def _yaw_error(yaws, poses):
    return np.mean([abs(wrap(yaw - pose.yaw)) for yaw, pose in zip(yaws, poses, strict=True)])


def test_the_least_errors_are_those_of_the_best_level():
    poses = walk(6.0, turning)
    sights = seen(poses, STD)
    truth = Poses(*np.array(poses).T)
    position, yaw = least_errors(sights, truth)
    yaws = [math.degrees(_yaw_error(smooth(sights, walks)[:, 2], poses)) for walks in LEVELS]
    assert yaw == pytest.approx(min(yaws), rel=1e-9)
    assert 0.0 < position < 0.05  # less than one observation is off
