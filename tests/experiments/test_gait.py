"""Gait events and what follows from them, of walks whose values are known."""

import math

import numpy as np
import pytest
from experiments.walks import RATE_HZ, SPEED_M_S, STRIDE_S, pendulum, person
from mecazen.config.people import Body, Limp
from mecazen_experiments.capture import angles
from mecazen_experiments.gait import about_path, events, parameters, true_gait


def test_angles_of_straight_legs_are_the_thigh_s():
    _, joints = pendulum()
    hip, knee, ankle = angles(joints).T[:3]
    # the trunk is upright: what is left is the pelvic tilt of 10 deg
    assert hip.max() == pytest.approx(math.degrees(0.4) + 10.0, abs=0.3)
    assert hip.min() == pytest.approx(math.degrees(-0.4) + 10.0, abs=0.3)
    assert knee == pytest.approx(0.0, abs=1e-5)
    assert abs(ankle).max() == pytest.approx(math.degrees(0.4), abs=0.3)


def test_events_are_where_the_feet_are_farthest_from_the_pelvis():
    t, joints = pendulum()
    found = events(t, about_path(joints, RATE_HZ))
    for train, phase in zip(found, (0.0, 0.5, 0.5, 0.0), strict=True):
        wrong = (train / STRIDE_S - phase + 0.5) % 1.0 - 0.5
        assert len(train) >= 8
        assert abs(wrong).max() * STRIDE_S < 0.005


@pytest.mark.parametrize("yaw", [0.0, 2.0, -2.5])
@pytest.mark.parametrize("late", [0.5, 0.45])
def test_parameters_of_a_pendulum(yaw, late):
    t, joints = pendulum(yaw=yaw, late=late)
    gait = parameters(t, about_path(joints, RATE_HZ))
    assert gait.stride_time_s == pytest.approx(STRIDE_S, abs=0.001)
    assert gait.stride_length_m == pytest.approx(STRIDE_S * SPEED_M_S, abs=0.002)
    assert gait.cadence_per_min == pytest.approx(120.0 / STRIDE_S, rel=0.001)
    assert gait.stance_share == pytest.approx(0.5, abs=0.005)
    # the left step takes 1 - late of the stride, the right one late
    assert gait.step_time_asymmetry == pytest.approx((1.0 - 2.0 * late) / 0.5, abs=0.01)


@pytest.mark.parametrize("speed", [0.6, 1.3])
def test_events_of_the_simulated_person_are_near_those_of_their_planted_feet(speed):
    t, joints, phases = person(speed, rate_hz=50.0)
    true = true_gait(t, joints)
    found = parameters(t, about_path(joints, 50.0))
    strides = np.unwrap(phases[:, 0], period=1.0)
    stride_s = (t[-1] - t[0]) / (strides[-1] - strides[0])
    assert true.stride_time_s == pytest.approx(stride_s, abs=0.004)
    assert true.stride_length_m == pytest.approx(speed * stride_s, abs=0.005)
    assert true.step_time_asymmetry == pytest.approx(0.0, abs=0.02)
    assert found.stride_time_s == pytest.approx(stride_s, abs=0.002)
    assert found.stride_length_m == pytest.approx(true.stride_length_m, abs=0.005)
    # the method takes a step to end before the heel is down, and to begin after the toes are up
    assert 0.0 < found.stance_share - true.stance_share < 0.07


def test_a_limp_is_told_by_its_steps_and_stances():
    limp = Limp(side="right", stance_asymmetry=0.08, step_asymmetry=0.2)
    t, joints, _ = person(0.8, rate_hz=50.0, body=Body(limp=limp))
    true = true_gait(t, joints)
    found = parameters(t, about_path(joints, 50.0))
    # a sample of 20 ms is 0.015 of a stride
    assert true.stance_asymmetry == pytest.approx(0.08, abs=0.015)
    assert found.stance_asymmetry == pytest.approx(0.08, abs=0.05)  # by extrema, not by contacts
    for gait in (true, found):
        assert gait.step_length_asymmetry == pytest.approx(-0.2, abs=0.02)


def test_who_stands_does_not_walk():
    _, joints = pendulum()
    assert about_path(joints - joints[:, :1] * (1.0, 1.0, 0.0), RATE_HZ) is None
    t, joints, _ = person(1.0, duration_s=4.0)
    assert true_gait(t, joints) is None


def test_who_walks_backwards_still_looks_ahead():
    t, joints = pendulum(yaw=0.0)
    walk = about_path(joints[::-1], RATE_HZ)
    assert walk.forward == pytest.approx(np.tile((1.0, 0.0), (len(t), 1)), abs=1e-6)
    assert walk.placed(walk.joints) == pytest.approx(joints[::-1])
