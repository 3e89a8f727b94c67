"""Studies of very short runs, and the command line that does them."""

import csv
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest
from harness import ROOT, command
from mecazen_tools.cli.app import app

GUARD_S = 300
"""Far beyond what anything here takes: only a hang gets there."""

SCENARIO = f"""
robot = "{ROOT}/configs/robots/nexus.toml"
sim.duration_s = 2.0
start.x_m = -1.0
"""
STUDY = """
seeds = 4
[[cases]]
name = "short"
scenario = "short.toml"
[[table]]
title = "Errors"
rows = ["case"]
columns = [["D_err [m]", "d_err_m", 3]]
"""


def experiment(*arguments: object) -> None:
    """Run `mecazen experiment` in this process."""
    app(["experiment", *map(str, arguments)], standalone_mode=False)


class Folder(NamedTuple):
    """A folder of a test's own, in which `mecazen` is started."""

    path: Path

    def write(self, name: str, text: str) -> Path:
        """Write a file, and the folders above it."""
        file = self.path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def popen(self, *arguments: object) -> subprocess.Popen[str]:
        """Start `mecazen experiment` as a shell does: in a process group of its own."""
        call = command(["experiment", *arguments]) | {"cwd": self.path, "process_group": 0}
        return subprocess.Popen(**call, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def mecazen(self, *arguments: object, code: int = 0) -> tuple[str, str]:
        """Run `mecazen experiment`; return what it prints, and its errors."""
        return self.finish(self.popen(*arguments), code)

    @staticmethod
    def finish(process: subprocess.Popen[str], code: int = 0) -> tuple[str, str]:
        """Wait for a process that is to end with `code`; return what it printed."""
        out, errors = process.communicate(timeout=GUARD_S)
        assert process.returncode == code, errors
        return out, errors.strip()

    def runs(self, file: str) -> list[dict[str, str]]:
        """Return the rows of a CSV."""
        with (self.path / file).open() as rows:
            return list(csv.DictReader(rows))


@pytest.fixture(scope="session")
def make_folder():
    """Make folders with a short scenario, and a study of it."""

    def make(path):
        folder = Folder(path)
        folder.write("short.toml", SCENARIO)
        folder.write("study.toml", STUDY)
        return folder

    return make


@pytest.fixture
def folder(make_folder, tmp_path):
    """A folder of the test's own."""
    return make_folder(tmp_path)
