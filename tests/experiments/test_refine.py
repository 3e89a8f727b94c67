"""The estimator that refines a skeleton, on noise that is known."""

import numpy as np
import pytest
from experiments.walks import person, reported
from mecazen.skeleton import INDEX, SIDES
from mecazen_experiments.capture import angles
from mecazen_experiments.refine import LOWER, UPPER, refine, smooth, unswapped

JOINT = {"hip": [0, 3], "knee": [1, 4], "ankle": [2, 5]}


def rms(found, truth):
    errors = angles(found) - angles(truth)
    return {name: float(np.sqrt(np.mean(errors[:, at] ** 2))) for name, at in JOINT.items()}


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
    for name, error in rms(refine(reported(t, joints)), joints).items():
        assert error < 0.5, name


def test_a_precise_skeleton_stays_as_it_is_however_strides_differ(walk):
    t, joints = walk
    differing = joints.copy()
    differing[:, [INDEX["left_knee"], INDEX["right_ankle"]], 0] += 0.02 * np.sin(t)[:, None]
    for name, error in rms(refine(reported(t, differing, 1e-4)), differing).items():
        # a frame weighs (5 mm / 0.1 mm)² more than the cycle, from which these stray by 20 mm
        assert error < 0.05, name


def test_errors_become_smaller_by_far_more_than_a_quarter(walk):
    t, joints = walk
    random = np.random.default_rng(1)
    white = random.normal(0.0, 0.015, joints.shape)
    bias = random.normal(0.0, 0.02, joints.shape[1:])
    bias[:, 2] *= 0.5
    seen = reported(t, joints + bias + white, 0.025)
    raw, refined = rms(seen.joints, joints), rms(refine(seen), joints)
    for name in JOINT:
        assert refined[name] < 0.75 * raw[name], name


@pytest.mark.parametrize("names", [LOWER, UPPER, LOWER + UPPER])
def test_swaps_are_undone(walk, names):
    t, joints = walk
    noisy = joints + np.random.default_rng(2).normal(0.0, 0.01, joints.shape)
    wrong = swap(noisy, np.r_[40:52, 120:123], names)
    assert unswapped(reported(t, wrong, 0.02)).joints == pytest.approx(noisy)
    assert unswapped(reported(t, noisy, 0.02)).joints == pytest.approx(noisy)


def test_a_whole_body_that_is_mirrored_for_seconds_is_put_right(walk):
    t, joints = walk
    rows = (t > 5.0) & (t < 8.5)
    wrong = swap(joints, rows, LOWER + UPPER)
    put_right = unswapped(reported(t, wrong, 0.02)).joints
    # where a mirror image begins and ends, its line from right to left is not known
    sure = abs(t[:, None] - (5.0, 8.5)).min(axis=1) > 0.3
    assert put_right[sure] == pytest.approx(joints[sure])


def test_frames_without_anybody_are_bridged(walk):
    t, joints = walk
    gappy = joints.copy()
    gappy[60:75] = np.nan
    seen = reported(t, gappy)
    assert not np.isnan(smooth(seen)).any()
    for error in rms(refine(seen), joints).values():
        assert error < 0.6


def test_there_is_nothing_to_refine_of_who_stands_or_is_not_seen(walk):
    t, joints = walk
    standing = np.tile(joints[:1], (len(t), 1, 1))
    assert refine(reported(t, standing)) is None
    assert refine(reported(t, np.full_like(joints, np.nan))) is None


def test_heel_and_ball_show_how_far_an_ankle_is_aside(walk):
    t, joints = walk
    wrong = joints.copy()
    # the walk is along x
    wrong[:, INDEX["left_ankle"], 1] += 0.03
    aside = (refine(reported(t, wrong, 0.02)) - joints)[:, INDEX["left_ankle"], 1]
    # the line is as sure as the ankle: errors of heel, ball and of the line's own 1 cm
    assert 0.0 < aside.mean() < 0.02
