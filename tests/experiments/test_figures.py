"""The figures: that they are written, what they say, and that they show the runs."""

import math
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from mecazen_experiments import figures
from mecazen_experiments.figures import draw, errors, trajectories
from mecazen_tools.table import Table

TICKS = 600
TICK_S = 0.1
RUNS = ["back without", "side without", "back with", "side with"]
"""In the order of the panels of Fig. 5."""
PANELS = {
    "fig5_trajectories": [
        "(a) back, without",
        "(b) side, without",
        "(c) back, with",
        "(d) side, with",
    ],
    "fig8_errors": [
        "(a) back, distance",
        "(b) back, angle",
        "(c) side, distance",
        "(d) side, angle",
    ],
}


def table(bearing_deg, heading_deg, distance):
    """A person who walks 6 m, and a robot that is off by a little more all the time."""
    t = TICK_S * np.arange(TICKS)
    bearing, heading = math.radians(bearing_deg), math.radians(heading_deg)
    columns = {
        "t_s": t,
        "target_x_m": 0.1 * t,
        "target_y_m": 0.0 * t,
        "target_yaw_rad": 0.0 * t,
        "robot_x_m": 0.1 * t + distance * (1.0 + 0.001 * t) * math.cos(bearing),
        "robot_y_m": distance * (1.0 + 0.001 * t) * math.sin(bearing),
        "robot_yaw_rad": heading - 0.001 * t,
    }
    return Table(columns, TICK_S)


@pytest.fixture(scope="module")
def tables():
    return {
        "back without": table(180.0, 0.0, 1.4),
        "back with": table(180.0, 0.0, 1.1),
        "side without": table(90.0, -90.0, 1.3),
        "side with": table(90.0, -90.0, 1.2),
    }


@pytest.fixture(scope="module")
def drawn(tables, tmp_path_factory):
    return draw(tables, tmp_path_factory.mktemp("figures") / "new" / "folder")


def titles(figure):
    return [axes.get_title() for axes in figure.axes]


def test_each_figure_is_written_as_png_and_as_svg(drawn):
    assert [file.name for file in drawn] == [
        f"{n}.{kind}" for n in PANELS for kind in ("png", "svg")
    ]
    for file in drawn:
        begin = b"\x89PNG" if file.suffix == ".png" else b"<?xml"
        assert file.read_bytes().startswith(begin)


@pytest.mark.parametrize("name", PANELS)
def test_an_svg_holds_its_labels_as_text(drawn, name):
    svg = ElementTree.parse(drawn[0].with_name(f"{name}.svg")).getroot()  # noqa: S314 (ours)
    texts = [text.text for text in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert [text for text in texts if text.startswith("(")] == PANELS[name]


def test_the_same_runs_give_the_same_bytes_whatever_the_users_style(tables, drawn, tmp_path):
    with mpl.rc_context({"font.size": 20.0, "lines.linestyle": ":", "svg.fonttype": "path"}):
        again = [file.read_bytes() for file in draw(tables, tmp_path)]
    assert again == [file.read_bytes() for file in drawn]


def test_a_figure_is_a_column_wide_and_its_text_7_points(tables):
    for figure in (trajectories(tables), errors(tables)):
        assert 25.4 * figure.get_figwidth() == pytest.approx(85.0)
        texts = [text for axes in figure.axes for text in (axes.title, *axes.get_xticklabels())]
        assert {text.get_fontsize() for text in texts} == {7.0}


def test_the_trajectories_are_those_of_the_tables(tables):
    figure = trajectories(tables)
    assert titles(figure) == PANELS["fig5_trajectories"]
    for axes, name in zip(figure.axes, RUNS, strict=True):
        person, robot = axes.lines
        for line, who in ((person, "target"), (robot, "robot")):
            assert np.array_equal(line.get_xdata(), tables[name][f"{who}_x_m"])
            assert np.array_equal(line.get_ydata(), tables[name][f"{who}_y_m"])
        assert axes.get_aspect() == 1.0


def test_arrows_show_the_robots_heading_and_where_the_person_sets_out(tables):
    for axes, name in zip(trajectories(tables).axes, RUNS, strict=True):
        robot, person = axes.collections
        every = round(figures.ARROW_EVERY_S / TICK_S)
        yaw = tables[name]["robot_yaw_rad"][::every]
        assert np.arctan2(robot.V, robot.U) == pytest.approx(yaw)
        assert np.array_equal(robot.X, tables[name]["robot_x_m"][::every])
        assert np.array_equal(robot.Y, tables[name]["robot_y_m"][::every])
        assert (person.X, person.Y, person.V) == (0.0, 0.0, 0.0)
        assert person.U > 0.0


def test_the_errors_are_those_of_the_tables(tables):
    figure = errors(tables)
    assert titles(figure) == PANELS["fig8_errors"]
    t = TICK_S * np.arange(TICKS)
    distances = {"back": (1.4, 1.1), "side": (1.3, 1.2)}
    for view, (distance, angle) in zip(distances, (figure.axes[:2], figure.axes[2:]), strict=True):
        for line, off in zip(distance.lines, distances[view], strict=True):
            assert np.array_equal(line.get_xdata(), t)
            assert line.get_ydata() == pytest.approx(off * (1.0 + 0.001 * t) - 1.0)
        for line in angle.lines:
            assert line.get_ydata() == pytest.approx(np.degrees(-0.001 * t), abs=1e-9)


def test_without_and_with_differ_in_more_than_colour(tables):
    for axes in errors(tables).axes:
        without, with_ = axes.lines
        assert (without.get_label(), with_.get_label()) == ("without", "with")
        assert without.get_linestyle() == "--"
        assert with_.get_linestyle() == "-"
