"""Poses of many ticks, against those of one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen import geometry
from mecazen.geometry import Pose2D
from mecazen_experiments.table import Poses, wrap

numbers = st.floats(-100.0, 100.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2D, numbers, numbers, angles)
pairs = st.lists(st.tuples(poses, poses), min_size=1, max_size=5)
ROUNDING = 1e-12
"""A coordinate of up to 400 has a rounding of 6e-14; some of them add up."""


def many(of_one):
    return Poses(*np.array(of_one).T)


def assert_same(found, expected):
    for tick, pose in enumerate(expected):
        assert found.at(tick)[:2] == pytest.approx(pose[:2], abs=ROUNDING)
        assert geometry.wrap(found.at(tick).yaw - pose.yaw) == pytest.approx(0.0, abs=ROUNDING)


@given(pairs)
def test_compose_is_that_of_each_pose(pairs):
    left, right = zip(*pairs, strict=True)
    assert_same(many(left).compose(many(right)), [a.compose(b) for a, b in pairs])


@given(pairs)
def test_between_is_that_of_each_pose(pairs):
    left, right = zip(*pairs, strict=True)
    assert_same(many(left).between(many(right)), [a.between(b) for a, b in pairs])


@given(st.lists(poses, min_size=1, max_size=5), poses)
def test_compose_with_one_pose_takes_it_for_all(left, right):
    assert_same(many(left).compose(right), [pose.compose(right) for pose in left])


def test_wrap_brings_angles_to_between_minus_and_plus_half_a_turn():
    angles = wrap(np.radians([0.0, 179.0, 181.0, -181.0, 360.0, 730.0]))
    assert np.degrees(angles) == pytest.approx([0.0, 179.0, -179.0, 179.0, 0.0, 10.0], abs=1e-12)
