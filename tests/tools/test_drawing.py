"""Figures as files."""

import sys

import pytest
from harness import error_of
from matplotlib.figure import Figure
from mecazen.errors import MecazenError
from mecazen_tools import drawing
from mecazen_tools.cli import app


def test_a_picture_has_the_format_of_its_suffix_and_the_same_bytes_each_time(tmp_path):
    drawn = Figure()
    drawn.subplots().plot([0.0, 1.0], [1.0, 0.0], label="a line")
    for suffix, begin in {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}.items():
        first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
        drawing.save(drawn, first)
        drawing.save(drawn, second)
        assert first.read_bytes() == second.read_bytes()
        assert first.read_bytes().startswith(begin)


def test_what_cant_be_drawn_is_refused_before_the_run(monkeypatch, tmp_path):
    monkeypatch.setattr(app, "simulate", lambda *_: pytest.fail("it ran"))
    monkeypatch.setitem(sys.modules, "matplotlib", None)

    def refused(name):
        arguments = ["simulate", "back", "--plot", str(tmp_path / name)]
        return error_of(MecazenError, lambda: app.app(arguments, standalone_mode=False))

    assert refused("run.gif").endswith("run.gif: a picture's name ends in one of .png, .svg, .pdf")
    assert refused("no/run.png").endswith("no/run.png: no such folder")
    assert refused("run.png") == "--plot needs Matplotlib: pip install 'mecazen[plot]'"
