"""LDLᵀ factors of symmetric 3x3 matrices: A = L D Lᵀ, L with a unit diagonal.

Golub, van Loan: Matrix Computations, section 4.1. Plain floats, since the overhead of a call
to LAPACK exceeds the computation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

Rows = Sequence[Sequence[float]]
"""A matrix, row by row."""
Row = tuple[float, float, float]


class Factors(NamedTuple):
    """The entries of L below its diagonal, and the diagonal of D."""

    yx: float
    zx: float
    zy: float
    pivots: Row
    """The diagonal of D; all are positive."""

    @property
    def determinant(self) -> float:
        """The determinant."""
        x, y, z = self.pivots
        return x * y * z

    def quadratic(self, vector: Sequence[float]) -> float:
        """Return vᵀ A⁻¹ v for a vector v (3)."""
        x, y, z = vector
        y -= self.yx * x
        z -= self.zx * x + self.zy * y
        dx, dy, dz = self.pivots
        return x * x / dx + y * y / dy + z * z / dz

    def inverse(self) -> tuple[Row, Row, Row]:
        """Return A⁻¹."""
        yx, zx, zy, (dx, dy, dz) = self
        zx = zy * yx - zx  # the entry of L⁻¹
        zz = 1.0 / dz
        xz, yz = zx * zz, -zy * zz
        yy, xy = 1.0 / dy - zy * yz, -yx / dy - zy * xz
        return (1.0 / dx + yx * yx / dy + zx * xz, xy, xz), (xy, yy, yz), (xz, yz, zz)


def factors(matrix: Rows) -> Factors:
    """Return the factors of a symmetric matrix (3, 3); only the lower triangle is read.

    Raises:
        ValueError: The matrix is not positive definite.
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


def is_positive(matrix: Rows) -> bool:
    """Return whether a symmetric matrix (3, 3) is positive definite."""
    try:
        factors(matrix)
    except ValueError:
        return False
    return True
