"""The tests mirror the code: the tests of a module are found by its name."""

import ast
from pathlib import Path

import pytest
from harness import ROOT

INITS = (*ROOT.glob("*/mecazen*/__init__.py"), *ROOT.glob("services/*/mecazen*/__init__.py"))
PACKAGES = {init.parents[1].name.replace("ros2", "ros"): init.parent for init in INITS}
"""The package of each folder of tests."""
APART = {"bus", "runtime"}
"""Sub-packages whose modules share no file of tests."""


def has_logic(module: Path) -> bool:
    """Return whether a module has a function with statements, besides properties and checks."""
    functions = (n for n in ast.walk(ast.parse(module.read_text())) if type(n) is ast.FunctionDef)
    return any(
        f.name != "__post_init__"
        and "property" not in map(ast.unparse, f.decorator_list)
        and not all(isinstance(one, ast.Expr) for one in f.body)  # a protocol
        for f in functions
    )


@pytest.mark.parametrize("folder", sorted(PACKAGES))
def test_each_module_with_logic_has_a_file_of_tests(folder):
    package, lacking = PACKAGES[folder], []
    for module in package.rglob("*.py"):
        shares = module.parent != package and module.parent.name not in APART
        names = {module.stem, module.parent.name if shares else module.stem}
        tests = ROOT / "tests" / folder
        beside = tests / module.parent.relative_to(package) / f"test_{module.stem}.py"
        found = any(file.exists() for file in (beside, *(tests / f"test_{n}.py" for n in names)))
        if not module.stem.startswith("__") and has_logic(module) and not found:
            lacking.append(str(module.relative_to(package)))
    assert lacking == []
