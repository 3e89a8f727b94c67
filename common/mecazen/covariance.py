"""Covariances: ROS's row-major 6x6, and the planar 3x3 over (x, y, yaw) in it."""

from __future__ import annotations

from operator import itemgetter

from mecazen.errors import RefusedError

PlanarCovariance = tuple[tuple[float, ...], ...]
"""3x3 over x [m], y [m] and yaw [rad], row by row."""

planar_entries = itemgetter(0, 1, 5, 6, 7, 11, 30, 31, 35)
"""Takes the entries of x, y and yaw from a row-major 6x6; the others may be 1e99: "unknown"."""


def planar_covariance(covariance: tuple[float, ...]) -> PlanarCovariance:
    """Return the 3x3 over (x, y, yaw) of ROS's row-major 6x6.

    Raises:
        RefusedError: It has another size.
    """
    if len(covariance) != 36:
        raise RefusedError(f"a covariance has 36 numbers, not {len(covariance)}")
    xx, xy, xw, yx, yy, yw, wx, wy, ww = planar_entries(covariance)
    return (xx, xy, xw), (yx, yy, yw), (wx, wy, ww)


def ros_covariance(planar: PlanarCovariance) -> tuple[float, ...]:
    """Return ROS's row-major 6x6 of a 3x3 over (x, y, yaw); other entries are 0."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = planar
    zeros = 0.0, 0.0, 0.0
    return (xx, xy, *zeros, xw, yx, yy, *zeros, yw, *6 * zeros, wx, wy, *zeros, ww)


def diagonal_covariance(variances: tuple[float, ...]) -> tuple[float, ...]:
    """Return ROS's row-major 6x6 with the six variances of x, y, z, roll, pitch and yaw."""
    return tuple(
        variances[row] if row == column else 0.0 for row in range(6) for column in range(6)
    )
