"""A recorded run as a trajectory; tests/system compares it with that of the run."""

import pytest
from harness import SCENARIOS, error_of
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario, to_toml
from mecazen.messages import Time, Twist, planar_odometry
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError, RecordingWriter
from mecazen_tools.recorded import trajectory_of
from mecazen_tools.run_figure import ERRORS, VELOCITIES, courses, draw
from recorder.ticks import stamp_of

TICKS = range(3)
BODIES = "ground_truth/odom", "target/odom"


@pytest.fixture
def record(tmp_path):
    """Record what is at some keys for a few ticks of run 7, and a command by hand."""

    def write(scenario, *keys):
        path = tmp_path / "run.mcap"
        writer = RecordingWriter(path)
        writer.write_run(stamp_of(0), to_toml(scenario))
        for number in TICKS:
            for key in keys:
                writer.write(key, odometry(key, number), stamp_of(number), number * 10**7)
        writer.write("cmd_vel", Twist.planar(Twist2D(0.25)), None, 10**7)
        writer.close()
        return path

    return write


def odometry(key, number):
    place = Pose2D(0.1 * number, float(len(key)), 0.2)
    return planar_odometry(Time(), "world", "base_link", place, Twist2D(0.5))


@pytest.mark.parametrize(
    ("keys", "panels"),
    [(("ground_truth/odom",), VELOCITIES), (BODIES, {**ERRORS, **VELOCITIES})],
)
def test_panels_are_those_of_what_was_recorded(keys, panels, record):
    run = trajectory_of(Recording(record(load_scenario(SCENARIOS / "teleop.toml"), *keys)))
    assert (run.run, run.scenario.seed) == (7, 3)
    _, *drawn = draw(courses(run), run.scenario, "").axes
    assert [axes.get_ylabel() for axes in drawn] == [*panels]
    ahead, sideways, _ = drawn[-3:]
    assert ahead.lines[1].get_ydata() == pytest.approx([0.25])  # commanded, not stamped
    assert sideways.get_ylim() == (-0.1, 0.1)  # where nothing moves


def test_missing_data_of_a_figure_is_one_line(record, tmp_path):
    def problem(path, run=None):
        return error_of(RecordingError, lambda: trajectory_of(Recording(path), run))

    empty, cut = tmp_path / "empty.mcap", tmp_path / "cut.mcap"
    RecordingWriter(empty).close()
    assert problem(empty) == f"{empty}: no run in it"
    path = record(load_scenario(SCENARIOS / "side.toml"), "odom")
    assert problem(path) == f"{path}: nothing on ground_truth/odom in run 7"
    assert problem(path, 8) == f"--run 8: not in {path}, which holds 7"
    cut.write_bytes(path.read_bytes()[:200])
    assert problem(cut) == f"{cut}: no run in it, and its end is missing"
