"""The estimator that refines a skeleton, on noise that is known."""

import numpy as np
import pytest
from experiments.walks import person, reported
from mecazen.skeleton import INDEX, SIDES
from mecazen_experiments.gait.motion import angles
from mecazen_experiments.gait.refine import LOWER, UPPER, unswapped
from mecazen_experiments.gait.stages import seen_stages

JOINT = {"hip": [0, 3], "knee": [1, 4], "ankle": [2, 5]}


def rms(joints, truth):
    errors = angles(joints) - angles(truth)
    return {name: float(np.sqrt(np.mean(errors[:, at] ** 2))) for name, at in JOINT.items()}


def refined(seen):
    return seen_stages(seen)["refined"].joints


def swap(joints, rows, names):
    swapped = joints.copy()
    for name in names:
        left, right = (INDEX[f"{side}_{name}"] for side in SIDES)
        swapped[rows, left], swapped[rows, right] = joints[rows, right], joints[rows, left]
    return swapped


@pytest.fixture(scope="module")
def walk():
    t, joints, _ = person()
    return t, joints


@pytest.mark.parametrize("speed", [0.6, 1.3])
def test_a_perfect_skeleton_stays_as_it_is(speed):
    t, joints, _ = person(speed)
    assert max(rms(refined(reported(t, joints)), joints).values()) < 0.5


def test_a_precise_skeleton_stays_however_strides_differ(walk):
    t, joints = walk
    differing = joints.copy()
    differing[:, [INDEX["left_knee"], INDEX["right_ankle"]], 0] += 0.02 * np.sin(t)[:, None]
    # a frame weighs (5 mm / 0.1 mm)² more than the cycle, from which these stray by 20 mm
    assert max(rms(refined(reported(t, differing, 1e-4)), differing).values()) < 0.05


def test_errors_become_smaller_by_more_than_a_quarter(walk):
    t, joints = walk
    random = np.random.default_rng(1)
    white = random.normal(0.0, 0.015, joints.shape)
    bias = random.normal(0.0, 0.02, joints.shape[1:])
    bias[:, 2] *= 0.5
    seen = reported(t, joints + bias + white, 0.025)
    raw, errors = rms(seen.joints, joints), rms(refined(seen), joints)
    for name in JOINT:
        assert errors[name] < 0.75 * raw[name], name


@pytest.mark.parametrize("names", [LOWER, UPPER, LOWER + UPPER])
def test_swaps_are_undone(walk, names):
    t, joints = walk
    noisy = joints + np.random.default_rng(2).normal(0.0, 0.01, joints.shape)
    wrong = swap(noisy, np.r_[40:52, 120:123], names)
    assert unswapped(reported(t, wrong, 0.02)).joints == pytest.approx(noisy)
    assert unswapped(reported(t, noisy, 0.02)).joints == pytest.approx(noisy)


def test_a_body_that_is_mirrored_for_seconds_is_put_right(walk):
    t, joints = walk
    wrong = swap(joints, (t > 5.0) & (t < 8.5), LOWER + UPPER)
    put_right = unswapped(reported(t, wrong, 0.02)).joints
    # where a mirror image begins and ends, its line from right to left is not known
    sure = abs(t[:, None] - (5.0, 8.5)).min(axis=1) > 0.3
    assert put_right[sure] == pytest.approx(joints[sure])


def test_frames_without_a_body_are_bridged(walk):
    t, joints = walk
    gappy = joints.copy()
    gappy[60:75] = np.nan
    stages = seen_stages(reported(t, gappy))
    assert not np.isnan(stages["filtered"].joints).any()
    assert max(rms(stages["refined"].joints, joints).values()) < 0.6


def test_a_person_who_stands_or_is_not_seen_is_not_refined(walk):
    t, joints = walk
    standing = np.tile(joints[:1], (len(t), 1, 1))
    assert [*seen_stages(reported(t, standing))] == ["raw", "filtered"]
    assert [*seen_stages(reported(t, np.full_like(joints, np.nan)))] == ["raw"]


def test_heel_and_ball_show_how_far_an_ankle_is_aside(walk):
    t, joints = walk
    wrong = joints.copy()
    # the walk is along x
    wrong[:, INDEX["left_ankle"], 1] += 0.03
    aside = (refined(reported(t, wrong, 0.02)) - joints)[:, INDEX["left_ankle"], 1]
    # the line is as sure as the ankle: errors of heel, ball and of the line's own 1 cm
    assert 0.0 < aside.mean() < 0.02
