"""The turn rate model against Pose2D, against numerical calculus."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen_follower.estimators.turn_rate import (
    IDENTITY,
    SIZE,
    YAW,
    V,
    jacobian,
    matrix,
    move,
    process_noise,
    propagate,
    triangle,
    unwrap_yaw,
)

coordinates = st.floats(-10.0, 10.0)
rates = st.one_of(st.just(0.0), st.floats(-1e-6, 1e-6), st.floats(-5.0, 5.0))
states = st.tuples(coordinates, coordinates, coordinates, st.floats(-3.0, 3.0), rates).map(np.array)
times = st.floats(1e-3, 1.0)
walks = st.tuples(*[st.floats(0.0, 3.0)] * SIZE).map(np.array)


@given(states, times)
def test_move_is_the_exponential_map_of_a_pose(state, dt):
    x, y, yaw, v, w = state.tolist()
    pose = Pose2D(x, y, yaw).integrate(Twist2D(v, 0.0, w), dt)
    moved = move(state, dt)
    assert moved[:2] == pytest.approx(pose[:2], abs=1e-12)
    assert wrap(moved[YAW] - pose.yaw) == pytest.approx(0.0, abs=1e-12)
    assert moved[V:].tolist() == [v, w]


@given(states, times)
def test_jacobian_is_what_central_differences_give(state, dt):
    h = 1e-5
    slopes = np.transpose(
        [(move(state + nudge, dt) - move(state - nudge, dt)) / (2.0 * h) for nudge in h * IDENTITY]
    )
    # h² times third derivatives below 10, and 1e-14 of rounding over h
    assert jacobian(state, dt) == pytest.approx(slopes, abs=3e-9)


@given(walks, states, times)
def test_process_noise_is_a_covariance(walk, state, dt):
    Q = process_noise(walk, state, dt)
    assert (Q == Q.T).all()
    assert np.linalg.eigvalsh(Q)[0] >= -1e-14 * np.trace(Q)


@given(walks, st.floats(-math.pi, math.pi), times)
def test_process_noise_of_who_stands_is_the_integral_of_white_noise(walk, yaw, dt):
    # at v = w = 0 nothing depends on the heading's error, and the model is linear
    state = np.array([0.0, 0.0, yaw, 0.0, 0.0])
    position, heading, speed, rate = np.square(walk[1:])
    c, s = math.cos(yaw), math.sin(yaw)
    along = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    assert jacobian(state, 1.0) @ along == pytest.approx([c, s, 0.0, 1.0, 0.0])
    white = np.diag([position, position, heading, speed, rate])
    start, middle, end = (
        F @ white @ F.T for F in (jacobian(state, t) for t in (0.0, dt / 2.0, dt))
    )
    integral = (start + 4.0 * middle + end) * dt / 6.0  # Simpson: exact for squares of t
    assert process_noise(walk, state, dt) == pytest.approx(integral, rel=1e-12, abs=1e-12)


squares = st.lists(st.floats(-2.0, 2.0), min_size=SIZE**2, max_size=SIZE**2).map(
    lambda numbers: np.reshape(numbers, (SIZE, SIZE))
)


@given(walks, states, squares, times)
def test_propagate_moves_the_state_and_its_covariance_as_the_matrices_do(walk, state, root, dt):
    P, F = root @ root.T, jacobian(state, dt)
    carried, covariance = propagate(tuple(state), triangle(P), tuple(walk), dt)
    assert carried == pytest.approx(move(state, dt).tolist(), abs=1e-12)
    # each entry is a sum of 16 products below 20 (entries of P) times 9 (those of F, squared)
    expected = F @ P @ F.T + process_noise(walk, state, dt)
    assert matrix(covariance) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_sway_goes_by_the_distance_walked():
    walk = np.array([0.03, 0.0, 0.0, 0.0, 0.0])
    forth, back, still = (
        process_noise(walk, np.array([0.0, 0.0, 1.0, v, 0.0]), 0.5) for v in (2.0, -2.0, 0.0)
    )
    # 1 m walked
    assert np.diag(forth)[:2] == pytest.approx([0.03**2, 0.03**2])
    assert (forth == back).all()
    assert not still.any()


def test_an_observation_comes_with_the_turn_that_is_nearest():
    seen = unwrap_yaw(5.0 * math.tau + 3.0, Pose2D(1.0, 2.0, -3.0))
    assert seen == pytest.approx([1.0, 2.0, 6.0 * math.tau - 3.0])
