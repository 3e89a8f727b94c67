"""Array functions that are bit-identical on all processors that docs/time.md lists.

BLAS and LAPACK choose their kernels by the processor, and with them the order of each sum. Where
AVX-512 is present, NumPy computes exp, log, tan, powers and inverse trigonometric functions by its
own code, elsewhere by the C library's. Code that computes trajectories calls this module instead.
NumPy's sums, sqrt, sin, cos, hypot, and `einsum` without `optimize` are safe. For Python floats
use `math.fsum`: since Python 3.12 `sum` compensates its rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

NEWTON_STEPS = 8
"""Number of Newton steps; three reach double precision from the asymptotic root."""


def product(left: Floats, right: Floats | Sequence[float]) -> Floats:
    """Return `left @ right`: (..., i, j) by (j) or by (..., j, k)."""
    is_vector = not isinstance(right, np.ndarray) or right.ndim == 1
    result: Floats = np.einsum("...ij,j->...i" if is_vector else "...ij,...jk->...ik", left, right)
    return result


def inverse_and_determinant(matrix: Floats) -> tuple[Floats, Floats]:
    """Return inverses (..., n, n) and determinants (...) of symmetric positive definite matrices.

    The sweep operator of J. H. Goodnight: A tutorial on the SWEEP operator, The American
    Statistician 33, 1979. The determinant is the product of its pivots.
    """
    swept = matrix.copy()
    determinant = np.ones(matrix.shape[:-2])
    for k in range(matrix.shape[-1]):
        pivot, column = swept[..., k, k].copy(), swept[..., :, k].copy()
        row = swept[..., k, :] / pivot[..., None]
        swept -= column[..., :, None] * row[..., None, :]
        swept[..., k, :], swept[..., :, k] = row, column / -pivot[..., None]
        swept[..., k, k] = 1.0 / pivot
        determinant *= pivot
    return swept, determinant


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of a symmetric positive definite matrix (..., n, n)."""
    return inverse_and_determinant(matrix)[0]


def legendre(number: int) -> tuple[Floats, Floats]:
    """Return the nodes and weights (number) of Gauss-Legendre quadrature over -1 to 1.

    The nodes are the roots of the Legendre polynomial, by Newton's iteration.
    """
    nodes, weights = np.empty(number), np.empty(number)
    for i in range(number):
        x, slope = -math.cos(math.pi * (i + 0.75) / (number + 0.5)), 1.0
        for _ in range(NEWTON_STEPS):
            before, value = 1.0, x
            for n in range(2, number + 1):
                before, value = value, ((2 * n - 1) * x * value - (n - 1) * before) / n
            slope = number * (x * value - before) / (x * x - 1.0)
            x -= value / slope
        nodes[i], weights[i] = x, 2.0 / ((1.0 - x * x) * slope * slope)
    return nodes, weights


def _each(function: Callable[..., float], arguments: int) -> Callable[..., Floats]:
    of_objects = np.frompyfunc(function, arguments, 1)
    return lambda *values: np.asarray(of_objects(*values), float)


exp = _each(math.exp, 1)
tan = _each(math.tan, 1)
arctan2 = _each(math.atan2, 2)
