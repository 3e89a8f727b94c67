"""Ellipses and NEES."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D
from mecazen.messages import ros_covariance
from mecazen_viewer import covariance


def test_a_covariance_is_an_array_over_x_y_and_yaw():
    part = np.diag([1.0, 2.0, 3.0])
    read = covariance.planar(ros_covariance(part.tolist()))
    assert read.tolist() == part.tolist()


@pytest.mark.parametrize(
    "part",
    [
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1e300, 1e300, 1e300]),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ],
)
def test_what_is_no_covariance_is_none(part):
    assert covariance.planar(ros_covariance(part.tolist())) is None


def test_the_ellipse_holds_95_percent():
    # (x, y)·C⁻¹·(x, y) is chi-square with two freedoms, whose 95 % quantile is 5.991
    spread = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 1.0]])
    axes = covariance.ellipse_axes(spread)
    angles = np.linspace(0.0, math.tau, 7)
    outline = axes @ np.array([np.cos(angles), np.sin(angles)])
    squared = np.sum(outline * np.linalg.solve(spread[:2, :2], outline), axis=0)
    assert squared == pytest.approx(np.full(7, 5.991), abs=1e-3)


def test_the_ellipse_turns_with_the_frame_in_which_it_was_seen():
    axes = covariance.ellipse_axes(np.diag([1.0, 4.0, 1.0]), math.pi / 2)
    turned = axes @ axes.T
    assert turned / turned[1, 1] == pytest.approx(np.diag([4.0, 1.0]))


@given(
    st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    st.tuples(*[st.floats(0.1, 3.0)] * 3),
)
def test_nees_is_the_sum_of_squares_of_independent_errors(error, std):
    truth = Pose2D(3.0, -1.0, 3.0)
    estimate = Pose2D(*(a + b for a, b in zip(truth, error, strict=True)))
    nees = covariance.nees(estimate, truth, np.diag(np.square(std)))
    assert nees == pytest.approx(sum((e / s) ** 2 for e, s in zip(error, std, strict=True)))
