"""The figure of one run: what it shows, worked out by hand."""

import math

import numpy as np
import pytest
from harness import SCENARIOS, load_robot
from mecazen import keys
from mecazen.config import Scenario
from mecazen.loading import load_scenario
from mecazen_tools.run_figure import Course, courses, draw
from tools.runs import Run

T = np.array([0.0, 1.0])
STILL = np.zeros(2)


def rows(*columns):
    return np.column_stack(np.broadcast_arrays(*columns))


# who walks along y with the robot to be 1 m at their left, hence west, facing them
PERSON = rows(T, 2.0, T, math.pi / 2, *[STILL] * 3)
# and the robot, 0.25 m too far, which looks 10° too far to the left
ROBOT = rows(T, 0.75, T, math.radians(10.0), 0.5, 0.25, 0.125)
COMMAND = rows(T[:1], 0.4, 0.2, 0.1)


@pytest.fixture
def drawn():
    scenario = load_scenario(SCENARIOS / "side.toml")
    return draw([Course("", ROBOT, PERSON, COMMAND)], scenario, "by hand")


def test_wanted_place_and_errors_are_those_worked_out_by_hand(drawn):
    above, distance, heading, *velocities = drawn.axes
    by_name = {line.get_label(): line for line in above.lines}
    assert np.asarray(by_name["robot"].get_xydata()) == pytest.approx(ROBOT[:, 1:3])
    assert np.asarray(by_name["person"].get_xydata()) == pytest.approx(PERSON[:, 1:3])
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


def test_the_wanted_is_dashed_and_no_legend_lies_on_a_curve(drawn):
    (legend,) = drawn.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["person", "robot", "wanted"]
    for axes in drawn.axes:
        assert axes.get_legend() is None
        for line in axes.lines:
            assert line.is_dashed() == (line.get_label() == "wanted")


def test_what_robot_and_person_did_is_taken_from_the_table_of_a_run():
    run = Run(2)
    for tick, x in enumerate((0.5, 1.0)):
        run.tick(tick, robot=(x, 2.0, 0.25), person=(3.0, 4.0, 0.0))
    (way,) = courses(run.trajectory, Scenario(robot=load_robot()))
    moving = 0.5, 0.25, 1.0
    assert way.robot.tolist() == [[0.0, 0.5, 2.0, 0.25, *moving], [0.01, 1.0, 2.0, 0.25, *moving]]
    assert way.person[:, 1:4].tolist() == [[3.0, 4.0, 0.0]] * 2
    assert way.command[:, 1:].tolist() == [[0.125, -0.5, 2.0]] * 2
    alone = Run(1, services=("physics",))
    alone.pose(keys.GROUND_TRUTH, 0, 0.0, 0.0, 0.0)
    (way,) = courses(alone.trajectory, Scenario(robot=load_robot()))
    assert (len(way.robot), len(way.person), len(way.command)) == (1, 0, 0)
