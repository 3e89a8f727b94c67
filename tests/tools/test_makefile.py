"""Which Python `make` takes: the first one that runs and is in range."""

import os
import re
import shutil
import subprocess
import sys

import pytest
from harness import ROOT

REAL = f'exec {sys.executable} "$@"'
SHIM = "echo pyenv: command not found >&2; exit 127"
"""A shim of pyenv exists for every version that it has, and fails unless that is selected."""
OLD_VERSION = "import sys; sys.version_info = 3, 10, 4; exec(sys.argv[2])"
OLD = f"exec {sys.executable} -c '{OLD_VERSION}' \"$@\""


@pytest.fixture
def make_venv(tmp_path):
    """Return what `make` would run to create `.venv`, with these Pythons on the path."""

    def make(*settings, **pythons):
        for tool in ("bash", "make"):
            (tmp_path / tool).symlink_to(shutil.which(tool))
        for name, script in pythons.items():
            file = tmp_path / name.replace("_", ".")
            file.write_text(f"#!/bin/sh\n{script}\n")
            file.chmod(0o755)
        variables = {key: value for key, value in os.environ.items() if key != "PYTHON"}
        return subprocess.run(
            [tmp_path / "make", "--dry-run", "--always-make", "install", *settings],
            cwd=ROOT,
            env=variables | {"PATH": str(tmp_path), "MAKEFLAGS": ""},
            capture_output=True,
            text=True,
            check=False,
        )

    return make


@pytest.mark.parametrize(
    ("settings", "pythons", "used"),
    [
        ((), {"python3_13": REAL, "python3_12": REAL}, "python3.13"),
        ((), {"python3_13": SHIM, "python3_12": REAL, "python3": OLD}, "python3.12"),
        (("PYTHON=python3.11",), {"python3_13": REAL, "python3_11": REAL}, "python3.11"),
    ],
    ids=["the newest", "not a shim that fails", "the one that is named"],
)
def test_make_takes_the_first_python_in_range(make_venv, settings, pythons, used):
    done = make_venv(*settings, **pythons)
    assert done.returncode == 0, done.stderr
    assert f"python={used} && " in done.stdout
    # for extras
    assert re.search(r"--python \.venv/bin/python install .* pip -e '\.\[all\]'", done.stdout)


@pytest.mark.parametrize("settings", [(), ("PYTHON=python3.10",)], ids=["none found", "too old"])
def test_no_python_in_range_is_one_line(make_venv, settings):
    done = make_venv(*settings, python3=OLD, python3_10=OLD)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "Python 3.11, 3.12 or 3.13 with venv is needed" in line
