"""Figures and other files that commands write."""

import math
import os
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from harness import SCENARIOS, error_of
from matplotlib.figure import Figure
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario
from mecazen_tools import drawing
from mecazen_tools.files import write, write_with
from mecazen_tools.run_figure import Course, draw
from mecazen_tools.table import Table
from mecazen_tools.trajectory import POSE, TWIST


def columns(body, names, *values):
    return {f"{body}_{name}": value for name, value in zip(names, values, strict=True)}


def test_figure_shows_goal_errors_and_velocities():
    t, scenario = np.array([0.0, 1.0]), load_scenario(SCENARIOS / "side.toml")
    # a person walks along y; the goal is 1 m to their left, facing them; the robot is 0.25 m too
    # far from it and turned 10° too far to the left
    values = {
        "t_s": t,
        **columns("target", POSE, 2.0, t, math.pi / 2),
        **columns("robot", (*POSE, *TWIST), 0.75, t, math.radians(10.0), 0.5, 0.25, 0.125),
        **columns("cmd", TWIST, 0.4, 0.2, 0.1),
        "tracking": "following",
    }
    table = Table(dict(zip(values, np.broadcast_arrays(*values.values()), strict=True)), 1.0)
    figure = draw([Course("", table, scenario.follower.standoff)], scenario, "by hand")
    above, distance, heading, *velocities = figure.axes
    lines = {line.get_label(): np.asarray(line.get_xydata()) for line in above.lines}
    assert lines["robot"] == pytest.approx(np.column_stack([[0.75, 0.75], t]))
    assert lines["person"] == pytest.approx(np.column_stack([[2.0, 2.0], t]))
    assert lines["wanted"] == pytest.approx(np.column_stack([[1.0, 1.0], t]))
    assert distance.lines[0].get_ydata() == pytest.approx([0.25, 0.25])
    assert heading.lines[0].get_ydata() == pytest.approx([10.0, 10.0])
    for axes, *speeds in zip(velocities, (0.5, 0.25, 0.125), (0.4, 0.2, 0.1), strict=True):
        assert [line.get_ydata()[0] for line in axes.lines] == speeds


def test_figure_has_the_suffixs_format_and_reproducible_bytes(tmp_path):
    figure = Figure()
    figure.subplots().plot([0.0, 1.0], [1.0, 0.0], label="a line")
    for suffix, begin in {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}.items():
        first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
        for file in (first, second):
            drawing.save(figure, file)
            assert file.read_bytes().startswith(begin)
        assert first.read_bytes() == second.read_bytes()


def test_a_figure_that_cant_be_drawn_is_refused(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for name, reason in {
        "run.gif": "run.gif: a picture's name ends in one of .png, .svg, .pdf",
        "no/run.png": "no/run.png: no such folder",
        "run.png": "--plot needs Matplotlib: pip install 'mecazen[plot]'",
    }.items():
        refuse = partial(drawing.refuse_undrawable, tmp_path / name, "--plot")
        assert error_of(MecazenError, refuse).endswith(reason)


def test_a_failing_write_leaves_the_old_file(tmp_path):
    file = tmp_path / "run.csv"
    write(file, b"old")

    def write_half(path: Path) -> None:
        assert path.suffix == ".csv"  # which selects the format of a figure
        path.write_bytes(b"ne")
        raise OSError(28, os.strerror(28))

    text = error_of(MecazenError, lambda: write_with(file, write_half, "--trajectory"))
    assert text == f"--trajectory {file}: No space left on device"
    assert (file.read_bytes(), [*tmp_path.iterdir()]) == (b"old", [file])
    text = error_of(MecazenError, lambda: write(Path("/dev/full"), b"x"))  # written directly
    assert text == "/dev/full: No space left on device"
