"""Factors of symmetric matrices against LAPACK."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen_follower.estimators.symmetric import factors

numbers = st.floats(-10.0, 10.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
matrices = (
    st.lists(numbers, min_size=9, max_size=9)
    .map(lambda entries: np.reshape(entries, (3, 3)))
    .map(lambda root: root @ root.T + 0.1 * np.eye(3))
)


@given(matrices, vectors)
def test_inverse_determinant_and_square_are_those_of_lapack(matrix, vector):
    found = factors(matrix.tolist())
    # eigenvalues from 0.1 to 1000: 1e4 of condition, and that again for LAPACK's own error
    close = {"rel": 1e-8, "abs": 1e-8}
    inverse = np.array(found.inverse())
    assert inverse == pytest.approx(np.linalg.inv(matrix), **close)
    assert (inverse == inverse.T).all()
    assert found.determinant == pytest.approx(np.linalg.det(matrix), **close)
    squared = vector @ np.linalg.solve(matrix, vector)
    assert found.quadratic(vector.tolist()) == pytest.approx(squared, **close)


@given(st.lists(numbers, min_size=9, max_size=9).map(lambda entries: np.reshape(entries, (3, 3))))
def test_only_what_is_positive_definite_has_factors(matrix):
    symmetric = matrix + matrix.T
    least = np.linalg.eigvalsh(symmetric)[0]
    if least > 1e-9:
        factors(symmetric.tolist())
    elif least < -1e-9:
        with pytest.raises(ValueError, match="positive definite"):
            factors(symmetric.tolist())
