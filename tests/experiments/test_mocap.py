"""Motion capture: joints placed by odometry, errors that are known, and one short run."""

import math

import numpy as np
import pytest
from experiments.conftest import experiment
from experiments.made_up import BACK, person, reported, run
from harness import ROOT
from mecazen import messages as m
from mecazen.errors import MecazenError
from mecazen.skeleton import JOINTS
from mecazen_experiments.gait.motion import MEASURED, motions
from mecazen_experiments.mocap import quality
from mecazen_tools.table import Poses

WALKED_S = 12.0


def test_reported_joints_are_placed_by_odometry():
    header = m.Header(m.Time.from_ns(20_000_000))
    skeleton = m.Skeleton(header, joints=(m.Point(3.0, 1.0, 0.5),) * 20)
    before_start, nobody = m.Skeletons(), m.Skeletons(m.Header(m.Time.from_ns(60_000_000)))
    frames = [before_start, m.Skeletons(header, (skeleton,)), nobody]
    _, seen = motions([skeleton], frames)
    placed = seen.placed(Poses(*np.tile([[2.0], [0.0], [math.pi / 2]], 2)))
    assert placed.t == pytest.approx([0.02, 0.06])
    assert placed.reported.tolist() == [True, False]
    # 3 m ahead and 1 m to the left of a robot at (2, 0) that looks along y
    assert placed.joints[0] == pytest.approx(np.tile((1.0, 3.0, 0.5), (len(JOINTS), 1)))


@pytest.fixture(scope="module")
def walk():
    return person(duration_s=WALKED_S)


def measured(walk, seen=None):
    """The quality of the capture of a person who walks from the first tick on."""
    t, joints, _ = walk
    tracked = reported(t, joints if seen is None else seen)
    ticks = round(WALKED_S / 0.01)
    x = 1.2 * 0.01 * np.arange(ticks)
    robot = x - 1.0, 0.0, 0.0
    table = run(ticks, target=(x, 0.0, 0.0), robot=robot, odom=robot)
    return quality(table, reported(t, joints, 0.0), tracked, BACK)


def test_without_noise_nothing_is_wrong(walk):
    columns = measured(walk)
    assert [columns[f"raw_{joint}_deg"] for joint in MEASURED] == [0.0] * 3
    assert columns["knee_seen_percent"] == 100.0
    assert abs(columns["speed_err_percent"]) < 1.0
    assert abs(columns["stride_length_err_mm"]) < 20.0


def test_a_walk_that_no_frame_shows_has_columns_without_values(walk):
    columns = measured(walk, np.full_like(walk[1], np.nan))
    assert columns.keys() == measured(walk).keys()
    for name in ("raw_knee_deg", "refined_knee_deg", "strike_err_ms", "raw_jitter_mm"):
        assert columns[name] is None


SHORT = f"""
program = "mocap"
scenario = "{ROOT}/configs/scenarios/mocap.toml"
seeds = 1
set = ["sim.duration_s=7.5", "robot.camera.pitch_deg=22.0", "follower.standoff_m=2.0"]
[[cases]]
name = "normal"
[[table]]
title = "Stages"
each = {{ stage = ["raw", "refined"] }}
columns = [["knee [°]", "{{stage}}_knee_deg", 1]]
"""


def test_a_run_is_measured(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder.path)
    folder.write("study.toml", SHORT)
    experiment("run", "study.toml", "--jobs", 1, "--csv", "out.csv")
    (row,) = folder.runs("out.csv")
    for joint in MEASURED:
        assert float(row[f"refined_{joint}_deg"]) < 0.75 * float(row[f"raw_{joint}_deg"])
    assert float(row["stride_time_err_ms"]) < 15.0
    assert float(row["stride_length_err_mm"]) < 30.0
    assert float(row["knee_seen_percent"]) > 90.0
    assert "refined" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "words"),
    [("sensor.kind=pose", "normal, seed 1.*sensor.kind"), ("sim.duration_s=4.0", "two strides")],
)
def test_a_run_that_can_t_be_measured_is_one_line(folder, monkeypatch, setting, words):
    monkeypatch.chdir(folder.path)
    folder.write("study.toml", SHORT)
    with pytest.raises(MecazenError, match=words):
        experiment("run", "study.toml", "--jobs", 1, "--set", setting)
