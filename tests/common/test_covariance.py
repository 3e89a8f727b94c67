"""Covariances in ROS's row-major 6x6, and their planar part."""

import pytest
from mecazen.covariance import diagonal_covariance, planar_covariance, ros_covariance
from mecazen.errors import RefusedError

PLANAR = (0, 1, 5)
ROWS = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))


def test_a_diagonal_covariance_is_row_major():
    covariance = diagonal_covariance((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    assert {n: value for n, value in enumerate(covariance) if value} == {
        0: 1.0, 7: 2.0, 14: 3.0, 21: 4.0, 28: 5.0, 35: 6.0
    }  # fmt: skip


def test_the_planar_part_is_rows_and_columns_of_x_y_and_yaw():
    entries = tuple(float(number) for number in range(36))
    expected = tuple(tuple(entries[6 * row + column] for column in PLANAR) for row in PLANAR)
    assert planar_covariance(entries) == expected


def test_a_planar_covariance_in_ros_has_zeros_elsewhere_and_comes_back():
    covariance = ros_covariance(ROWS)
    assert planar_covariance(covariance) == ROWS
    assert sum(covariance) == sum(map(sum, ROWS))


def test_a_covariance_of_another_size_is_refused():
    with pytest.raises(RefusedError, match="36 numbers, not 9"):
        planar_covariance((0.0,) * 9)
