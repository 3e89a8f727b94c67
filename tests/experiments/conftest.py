"""Studies of very short runs, and the command line that does them."""

import csv
from pathlib import Path
from typing import NamedTuple

import pytest
from harness import ROOT
from mecazen_tools.cli.app import app

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


def run_command(*arguments: object) -> None:
    """Run `mecazen` in this process."""
    app([*map(str, arguments)], standalone_mode=False)


def experiment(*arguments: object) -> None:
    """Run `mecazen experiment` in this process."""
    run_command("experiment", *arguments)


class Folder(NamedTuple):
    """A folder with a short scenario, and a study of it."""

    path: Path

    def write(self, name: str, text: str) -> Path:
        """Write a file, and the folders above it."""
        file = self.path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def runs(self, file: str) -> list[dict[str, str]]:
        """Return the rows of a CSV."""
        with (self.path / file).open() as rows:
            return list(csv.DictReader(rows))


@pytest.fixture
def folder(tmp_path):
    """A folder of the test."""
    folder = Folder(tmp_path)
    folder.write("short.toml", SCENARIO)
    folder.write("study.toml", STUDY)
    return folder
