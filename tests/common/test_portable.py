"""Functions that are bit-identical on all processors, and that only those are called."""

import ast
import math
import re
from pathlib import Path

import numpy as np
import pytest
from harness import ROOT
from mecazen.portable import (
    arctan2,
    exp,
    inverse,
    inverse_and_determinant,
    legendre,
    product,
    tan,
)

COMPUTES_TRAJECTORIES = (
    *("common", "people", "gym", "services/physics", "services/controller", "services/target"),
    *("services/sensors", "services/guard", "services/follower"),
)
BY_THE_PROCESSOR = re.compile(
    r"np\.(dot|vdot|inner|matmul|tensordot|polyfit|convolve|correlate|cov|corrcoef|roots"
    r"|exp|exp2|expm1|log|log2|log10|log1p|logaddexp|power|float_power|cbrt|angle|tan|arcsin"
    r"|arccos|arctan|arctan2|sinh|cosh|tanh|arcsinh|arccosh|arctanh|(linalg|fft)\.\w+)|.*\.dot"
)
"""NumPy's functions that use BLAS or LAPACK, or other instructions where a processor has them."""


def processor_dependent(file: Path) -> list[str]:
    calls = []
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            calls.append(f"{file}:{node.lineno}: {ast.unparse(node)}")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            name = ast.unparse(node.func)
            # along an axis the norm is the root of a sum; without one it is a product of BLAS
            by_axis = any(key.arg == "axis" for key in node.keywords)
            if BY_THE_PROCESSOR.fullmatch(name) and not (name == "np.linalg.norm" and by_axis):
                calls.append(f"{file}:{node.lineno}: {name}")
    return calls


def test_code_that_computes_trajectories_calls_nothing_that_depends_on_the_processor():
    files = [file for folder in COMPUTES_TRAJECTORIES for file in (ROOT / folder).rglob("*.py")]
    assert len(files) > 100
    assert [line for file in files for line in processor_dependent(file)] == []


@pytest.mark.parametrize(
    ("left", "right"),
    [((3, 4), (4,)), ((3, 4), (4, 2)), ((5, 3, 4), (4, 2)), ((5, 3, 4), (5, 4, 2))],
)
def test_a_product_is_the_matrix_product(left, right):
    random = np.random.default_rng(1)
    a, b = random.standard_normal(left), random.standard_normal(right)
    assert product(a, b) == pytest.approx(a @ b, abs=1e-14)  # both round sums of four terms


@pytest.mark.parametrize("size", [1, 3, 8])
def test_inverses_and_determinants_of_covariances(size):
    root = np.random.default_rng(size).standard_normal((2, size, size))
    covariances = root @ root.swapaxes(1, 2) + np.eye(size)
    inverses, determinants = inverse_and_determinant(covariances)
    # the condition number is below 100
    identities = np.broadcast_to(np.eye(size), covariances.shape)
    assert product(inverses, covariances) == pytest.approx(identities, abs=1e-13)
    assert determinants == pytest.approx(np.linalg.det(covariances), rel=1e-12)
    assert (inverse(covariances[0]) == inverses[0]).all()


@pytest.mark.parametrize("number", [1, 2, 32])
def test_nodes_and_weights_are_those_of_gauss_legendre_quadrature(number):
    nodes, weights = np.polynomial.legendre.leggauss(number)  # exact to 3e-15
    assert legendre(number)[0] == pytest.approx(nodes, abs=4e-15)
    assert legendre(number)[1] == pytest.approx(weights, abs=4e-15)


def test_functions_of_arrays_equal_those_of_the_c_library():
    x, y = np.random.default_rng(1).standard_normal((2, 12)).tolist()
    assert exp(np.array(x)).tolist() == list(map(math.exp, x))
    assert tan(np.array(x)).tolist() == list(map(math.tan, x))
    assert arctan2(np.array(y), np.array(x)).tolist() == list(map(math.atan2, y, x))
    assert exp(np.array([[0.0]])).tolist() == [[1.0]]
    assert exp(np.empty(0)).shape == (0,)
