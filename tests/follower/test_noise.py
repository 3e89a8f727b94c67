"""Whether a data sheet that is too good is found out, and only then."""

import math

import numpy as np
import pytest
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.tracker import MAX_RATIO, ReportedNoise

FRAME_S = 0.04
STD = np.array([0.05, 0.05, math.radians(5.0)])
REPORTED = tuple(map(tuple, np.diag(STD**2).tolist()))


def learnt(position, yaw, frames=500, period=FRAME_S, acceleration=0.0):
    """Return the ratios of variances applied after frames of such a noise [standard deviations]."""
    rng, noise = np.random.default_rng(1), ReportedNoise()
    std = STD * (position, position, yaw)
    for number in range(frames):
        x, y, turn = (rng.normal(size=3) * std).tolist()
        time = number * period
        pose = Pose2D(x + acceleration * time**2 / 2.0, y, wrap(3.0 + turn))
        noise.learn(time, pose, noise.corrected(REPORTED))
    corrected = noise.corrected(REPORTED)
    return corrected[0][0] / REPORTED[0][0], corrected[2][2] / REPORTED[2][2]


@pytest.mark.parametrize("ratios", [(2.0, 1.0), (1.0, 2.0), (2.0, 2.0)])
def test_a_sensor_twice_as_noisy_as_it_says_is_found_out(ratios):
    found = learnt(*ratios)
    # a memory of 5 s holds 250 frames, whose second differences are worth 130: two deviations
    # of the variance are a quarter of it
    for ratio, variance in zip(ratios, found, strict=True):
        assert variance == pytest.approx(ratio**2, rel=0.3 if ratio > 1.0 else 1e-12)


@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_a_sensor_that_is_as_good_as_it_says_or_better_is_believed(ratio):
    assert learnt(ratio, ratio) == (1.0, 1.0)


def test_an_acceleration_is_not_taken_for_noise():
    assert learnt(1.0, 1.0, frames=100, acceleration=3.0) == (1.0, 1.0)


def test_nothing_is_learnt_from_frames_far_apart_and_the_ratio_is_bounded():
    assert learnt(2.0, 2.0, period=0.2) == (1.0, 1.0)
    assert learnt(10.0, 1.0)[0] == MAX_RATIO
