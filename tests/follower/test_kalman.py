"""The Kalman filter of one number, by hand."""

import numpy as np
import pytest
from mecazen_follower.estimators.kalman import PortableFilter


def test_predictions_and_corrections_are_those_by_hand():
    kf = PortableFilter(dim_x=1, dim_z=1)
    kf.x, kf.P, kf.H = np.array([1.0]), np.array([[1.0]]), np.array([[1.0]])
    kf.predict(F=np.array([[2.0]]), Q=np.array([[0.5]]))
    assert (kf.x[0], kf.P[0, 0]) == (2.0, 4.5)
    kf.update(np.array([4.0]), np.array([[0.5]]))
    # S = 5, K = 0.9, and of P a tenth is left
    assert (kf.y[0], kf.S[0, 0]) == pytest.approx((2.0, 5.0))
    assert (kf.x[0], kf.P[0, 0]) == pytest.approx((3.8, 0.45))


def test_an_input_moves_the_state_and_leaves_the_covariance():
    kf = PortableFilter(dim_x=1, dim_z=1)
    kf.x, kf.P = np.array([1.0]), np.array([[1.0]])
    kf.predict(u=np.array([3.0]), B=np.array([[0.5]]), Q=np.zeros((1, 1)))
    assert (kf.x[0], kf.P[0, 0]) == (2.5, 1.0)
