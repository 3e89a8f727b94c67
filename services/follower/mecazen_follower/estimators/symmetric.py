"""Symmetric matrices of three rows: A = L D Lᵀ, with ones on the diagonal of L.

Golub, van Loan: Matrix Computations, section 4.1. In plain numbers, since LAPACK takes longer to
be called than these take to compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

Rows = Sequence[Sequence[float]]
"""A matrix, row by row."""
Row = tuple[float, float, float]


class Factors(NamedTuple):
    """What is below the diagonal of L, and the diagonal of D."""

    yx: float
    zx: float
    zy: float
    pivots: Row
    """Above 0, all of them."""

    @property
    def determinant(self) -> float:
        """The determinant."""
        x, y, z = self.pivots
        return x * y * z

    def squared(self, vector: Sequence[float]) -> float:
        """Return vᵀ A⁻¹ v of a vector (3)."""
        x, y, z = vector
        y -= self.yx * x
        z -= self.zx * x + self.zy * y
        dx, dy, dz = self.pivots
        return x * x / dx + y * y / dy + z * z / dz

    def inverse(self) -> tuple[Row, Row, Row]:
        """Return A⁻¹."""
        yx, zx, zy, (dx, dy, dz) = self
        zx = zy * yx - zx  # of the inverse of L
        zz = 1.0 / dz
        xz, yz = zx * zz, -zy * zz
        yy, xy = 1.0 / dy - zy * yz, -yx / dy - zy * xz
        return (1.0 / dx + yx * yx / dy + zx * xz, xy, xz), (xy, yy, yz), (xz, yz, zz)


def factors(matrix: Rows) -> Factors:
    """Return the factors of a symmetric matrix (3, 3), of which the lower triangle is read.

    Raises:
        ValueError: It is not positive definite.
    """
    (xx, _, _), (yx, yy, _), (zx, zy, zz) = matrix
    if xx > 0.0:
        l_yx, l_zx = yx / xx, zx / xx
        yy -= l_yx * yx
        zy -= l_zx * yx
        if yy > 0.0:
            l_zy = zy / yy
            zz -= l_zx * zx + l_zy * zy
            if zz > 0.0:
                return Factors(l_yx, l_zx, l_zy, (xx, yy, zz))
    raise ValueError("matrix must be positive definite")
