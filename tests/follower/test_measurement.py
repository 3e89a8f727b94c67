"""Which poses and covariances a follower accepts."""

import math

import pytest
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen_follower.association import Measurement, check

HERE = Pose2D(1.0, 2.0, 0.5)
CERTAIN = ((0.0, 0.0, 0.0),) * 3
ALIKE = ((1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def diagonal(x, y, yaw):
    return (x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, yaw)


@pytest.mark.parametrize("covariance", [CERTAIN, ALIKE, diagonal(1e12, 1e-9, 0.0)])
def test_semidefinite_covariances_are_accepted(covariance):
    measurement = Measurement(HERE, covariance, "7")
    assert check(measurement) == measurement


@pytest.mark.parametrize(
    ("pose", "covariance", "reason"),
    [
        *((Pose2D(bad), ALIKE, "out of range") for bad in (math.nan, math.inf, 1e300)),
        (HERE, diagonal(math.nan, 1.0, 1.0), "finite"),
        (HERE, diagonal(math.inf, 1.0, 1.0), "finite"),
        (HERE, diagonal(-1.0, -1.0, -1.0), "positive"),
        (HERE, ((1.0, 2.0, 0.0), (2.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "positive"),
        (HERE, ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "symmetric"),
    ],
)
def test_an_invalid_pose_or_covariance_is_refused(pose, covariance, reason):
    with pytest.raises(RefusedError, match=reason):
        check(Measurement(pose, covariance))
