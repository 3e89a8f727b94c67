"""Covariances in ROS's row-major 6x6, and their planar part."""

import numpy as np
from mecazen.covariance import diagonal_covariance, planar_covariance, ros_covariance

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
ROWS = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))


def test_a_diagonal_covariance_is_row_major():
    variances = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    covariance = np.reshape(diagonal_covariance(variances), (6, 6))
    assert (covariance == np.diag(variances)).all()


def test_the_planar_part_is_rows_and_columns_of_x_y_and_yaw():
    entries = tuple(float(number) for number in range(36))
    planar = np.array(planar_covariance(entries))
    assert (planar == np.reshape(entries, (6, 6))[PLANAR]).all()


def test_a_planar_covariance_in_ros_has_zeros_elsewhere_and_comes_back():
    covariance = ros_covariance(ROWS)
    assert planar_covariance(covariance) == ROWS
    assert sum(covariance) == sum(map(sum, ROWS))
