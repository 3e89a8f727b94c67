"""The inputs of a run: its scenario, and the code and data that it loads."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import platform
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import msgspec
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.files import read_bytes
from mecazen.schema import OutputFile
from mecazen_tools.simulation import in_lockstep

PREFIX = "mecazen"
"""The first word of the names of all packages of the product."""
SERVICES = (
    *("mecazen_physics", "mecazen_controller", "mecazen_target"),
    *("mecazen_sensors", "mecazen_follower", "mecazen_guard"),
)
"""Packages of which a scenario names modules: all their code counts."""
LIBRARIES = ("dartpy", "filterpy", "msgspec", "mujoco", "numpy", "scipy")
"""Libraries that a result depends on."""
BUILT = {"__pycache__"}
CODE, TEXTS = ".py", {".md", ".pyi", ".typed"}


def fingerprint(scenario: Scenario) -> str:
    """Return the SHA-256 of a scenario without its seed.

    The hash covers canonical JSON in which each file (a recorded walk, a user's program) is
    represented by its content instead of its name. Imports of a user's program are not covered.
    """
    scenario = msgspec.structs.replace(
        in_lockstep(scenario),
        seed=0,
        programs={part: with_content(name) for part, name in scenario.programs.items()},
    )
    canonical = msgspec.json.encode(scenario, enc_hook=_content, order="sorted")
    return hashlib.sha256(canonical).hexdigest()


def with_content(program: str) -> str:
    """Return a program's name, or its class and the content of its file if it has one."""
    place, colon, name = program.partition(":")
    if not colon:
        return program
    if not place.endswith(CODE):
        file = _file_of(place)
        if file is None:
            raise ConfigError(f"{program}: there is no module {place}")
        place = str(file)
    return f"{_content(Path(place))}:{name}"


@cache
def version(module: str) -> str:
    """Return the SHA-256 of the code, the data and the libraries that a run by a module loads.

    The code is that of the module, of `SERVICES`, and of all modules of the product that these
    import; comments, docstrings and layout do not count. Data are the other files of the packages
    of these modules.
    """
    lines = [f"python {platform.python_version()}"]
    lines += [f"{name} {version_of(name)}" for name in LIBRARIES]
    digests = ((name, _digest(file)) for name, file in sorted(loaded(module).items()))
    lines += [f"{name} {digest}" for name, digest in digests]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@cache
def loaded(module: str) -> dict[str, Path]:
    """Return the files of code and data that a run by a module loads, by name."""
    code: dict[str, Path] = {}
    waiting = [module, *_modules_of(SERVICES)]
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if name in code or file is None:
            continue
        code[name] = file
        # a package is imported before its modules
        waiting += [name.rpartition(".")[0], *_imports(name, file)]
    folders = {file.parent for file in code.values() if file.name == "__init__.py"}
    data = {
        f"{folder.name}/{path.relative_to(folder)}": path
        for folder in folders
        for path in folder.rglob("*")
        if path.is_file()
        and path.suffix not in {CODE, *TEXTS}
        and BUILT.isdisjoint(path.parts)
        and next(above for above in path.parents if (above / "__init__.py").exists()) == folder
    }
    return code | data


def _modules_of(packages: Iterable[str]) -> list[str]:
    names = []
    for package in packages:
        file = _file_of(package)
        assert file is not None
        for path in file.parent.rglob(f"*{CODE}"):
            parts = path.relative_to(file.parent).with_suffix("").parts
            names.append(".".join((package, *(part for part in parts if part != "__init__"))))
    return names


@cache
def _file_of(name: str) -> Path | None:
    """Return the file of a module; None if there is none."""
    with suppress(ImportError, ValueError):
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None and spec.origin.endswith(CODE):
            return Path(spec.origin)
    return None


def _imports(name: str, file: Path) -> list[str]:
    """Return the modules of the product that a module imports, at its top or later."""
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    names = []
    for node in ast.walk(_tree(file)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join((*above, *filter(None, [node.module])))
            names += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return [name for name in names if name.partition(".")[0].startswith(PREFIX)]


@cache
def _tree(file: Path) -> ast.Module:
    """Return the statements of a file, without docstrings and imports for types."""
    tree = ast.parse(file.read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [part for part in node.body if not _is_idle(part)]
    return tree


def _digest(file: Path) -> str:
    """Return the SHA-256 of a file; of code, that of its statements."""
    content = file.read_bytes() if file.suffix != CODE else ast.dump(_tree(file)).encode()
    return hashlib.sha256(content).hexdigest()


def _is_idle(node: ast.AST) -> bool:
    match node:
        case ast.Expr(value=ast.Constant(value=str())) | ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return True
    return False


def _content(value: Any) -> str:
    if not isinstance(value, Path):
        raise NotImplementedError(f"no way to write {type(value).__name__} as JSON")
    if isinstance(value, OutputFile):
        return str(value)
    return hashlib.sha256(read_bytes(value)).hexdigest()
