"""The figure of one run: what it shows, and that a recording of the run gives the same one."""

import math
import sys

import numpy as np
import pytest
from harness import SCENARIOS, error_of
from mecazen import Simulation
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario
from mecazen_recorder.plot import figure as recorded
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError, RecordingWriter
from mecazen_tools import drawing, run_figure
from mecazen_tools.cli import app
from mecazen_tools.run_figure import Course, courses, draw

T = np.array([0.0, 1.0])
STILL = np.zeros(2)


def rows(*columns):
    return np.column_stack(np.broadcast_arrays(*columns))


def lines(axes):
    return [np.asarray(line.get_xydata()) for line in axes.lines]


def shown(figure):
    """All that is drawn as lines: by the names of the axes."""
    return {axes.get_ylabel(): lines(axes) for axes in figure.axes}


def test_wanted_place_and_errors_are_those_worked_out_by_hand():
    # who walks along y with the robot to be 1 m at their left, hence west, facing them
    person = rows(T, 2.0, T, math.pi / 2, *[STILL] * 3)
    # and the robot, 0.25 m too far, which looks 10° too far to the left
    robot = rows(T, 0.75, T, math.radians(10.0), 0.5, 0.25, 0.125)
    command = rows(T[:1], 0.4, 0.2, 0.1)
    scenario = load_scenario(SCENARIOS / "side.toml")
    drawn = draw([Course("", robot, person, command)], scenario, "by hand")
    above, distance, heading, *velocities = drawn.axes
    by_name = {line.get_label(): line for line in above.lines}
    assert np.asarray(by_name["robot"].get_xydata()) == pytest.approx(robot[:, 1:3])
    assert np.asarray(by_name["person"].get_xydata()) == pytest.approx(person[:, 1:3])
    assert np.asarray(by_name["wanted"].get_xydata()) == pytest.approx(rows(1.0, T))
    assert distance.lines[0].get_ydata() == pytest.approx([0.25, 0.25])
    assert heading.lines[0].get_ydata() == pytest.approx([10.0, 10.0])
    for axes, actual, wanted in zip(velocities, (0.5, 0.25, 0.125), (0.4, 0.2, 0.1), strict=True):
        assert axes.lines[0].get_ydata() == pytest.approx([actual] * 2)
        assert axes.lines[1].get_ydata() == pytest.approx([wanted])
    assert above.get_aspect() == 1.0
    assert above.get_title() == "by hand"
    assert [axes.get_ylabel().replace("\n", " ") for axes in drawn.axes] == [
        "y [m]",
        "distance error [m]",
        "heading error [°]",
        "vx [m/s]",
        "vy [m/s]",
        "wz [rad/s]",
    ]


def test_the_wanted_is_dashed_and_no_legend_lies_on_a_curve():
    with Simulation("side", duration_s=0.2) as sim:
        sim.run()
        drawn = draw(courses(sim.trajectory, sim.scenario), sim.scenario, "side")
    (legend,) = drawn.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["person", "robot", "wanted"]
    for axes in drawn.axes:
        assert axes.get_legend() is None
        for line in axes.lines:
            assert line.is_dashed() == (line.get_label() == "wanted")


@pytest.mark.parametrize("scenario", ["side", "convoy"])
def test_a_recording_gives_the_same_figure_as_the_run(scenario, tmp_path):
    file = tmp_path / "run.mcap"
    with Simulation(scenario, duration_s=0.2, record=file) as sim:
        sim.run()
        expected = draw(courses(sim.trajectory, sim.scenario), sim.scenario, "run")
    assert len(sim.trajectory.rows()) == 20
    drawn = recorded(Recording(file), None)
    assert drawn.axes[0].get_title().startswith("run.mcap, run ")
    for name, curves in shown(expected).items():
        for curve, other in zip(shown(drawn)[name], curves, strict=True):
            assert np.array_equal(curve, other), name


def test_without_a_follower_there_is_no_wanted_place_and_a_hand_is_seen(tmp_path):
    file = tmp_path / "run.mcap"
    with Simulation("teleop", duration_s=0.2, record=file) as sim:
        sim.command(vx=0.25)
        sim.run()
    drawn = recorded(Recording(file), None)
    assert [axes.get_ylabel() for axes in drawn.axes] == ["y [m]", *run_figure.VELOCITIES]
    assert set(drawn.axes[1].lines[1].get_ydata()) == {0.25}  # commanded, without a stamp
    low, high = drawn.axes[2].get_ylim()  # sideways, where only rounding is
    assert (low, high) == (-0.1, 0.1)


def test_a_picture_has_the_format_of_its_suffix_and_the_same_bytes_each_time(tmp_path):
    ways = [Course("", rows(T, T, *[STILL] * 5), np.empty((0, 7)), np.empty((0, 4)))]
    drawn = draw(ways, load_scenario(SCENARIOS / "teleop.toml"), "same")
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
    assert refused("run.png") == "--plot needs Matplotlib: pip install 'mecazen-tools[plot]'"


def test_a_recording_with_nothing_to_draw_says_in_one_line_what_is_missing(tmp_path):
    def told(name, run=None):
        return error_of(RecordingError, lambda: recorded(Recording(tmp_path / name), run))

    RecordingWriter(tmp_path / "empty.mcap", "cdr").close()
    assert told("empty.mcap") == f"{tmp_path}/empty.mcap: no run in it"
    some = tmp_path / "some.mcap"
    with Simulation("side", duration_s=0.1, record=some, **{"recorder.keys": ["odom"]}) as sim:
        sim.run()
    assert told("some.mcap").startswith(f"{some}: nothing on ground_truth/odom in run ")
    assert told("some.mcap", 8).startswith(f"--run 8: not in {some}, which holds ")
    (tmp_path / "cut.mcap").write_bytes(some.read_bytes()[:200])
    assert told("cut.mcap") == f"{tmp_path}/cut.mcap: no run in it, and its end is missing"
