"""The experiment of motion capture: its report and its figures, of one short run."""

import msgspec
import pytest
from experiments.conftest import experiment
from harness import ROOT, error_of
from mecazen.errors import MecazenError

SHORT = f"""
kind = "mocap"
seeds = 1
set = [
    "sim.duration_s=7.5",
    "robot.camera.pitch_deg=22.0",
    "start={{ x_m = $x_m, y_m = $y_m, yaw_deg = $yaw_deg }}",
]
[[cases]]
name = "normal"
scenario = "{ROOT}/configs/scenarios/mocap.toml"
[grid.view]
back = ["follower.bearing_deg=180.0", "follower.heading_deg=0.0"]
side_left = ["follower.bearing_deg=90.0", "follower.heading_deg=-90.0"]
[sweep]
"follower.standoff_m" = [2.0]
"target.path.speed_m_s" = [1.0]
"""
ONE = ("run", "short.toml", "--only", "view=back", "--jobs", 1)


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)


def test_one_run_is_scored_printed_and_drawn(tmp_path, capsys):
    experiment(*ONE, "--json", "out.json", "--figures", "figures", "--export", "walks")
    (row,) = msgspec.json.decode((tmp_path / "out.json").read_bytes())["rows"]
    assert row["labels"] == {
        "case": "normal",
        "view": "back",
        "follower.standoff_m": 2.0,
        "target.path.speed_m_s": 1.0,
    }
    (run,) = row["runs"]
    quality = run["record"]["scores"]
    raw, refined = (quality["rmse_deg"][stage] for stage in ("raw", "refined"))
    for joint in ("hip", "knee", "ankle"):
        assert refined[joint] < 0.75 * raw[joint]
        assert row["means"][f"refined_{joint}_deg"]["mean"] == refined[joint]
    for side in ("left", "right"):
        found, true = quality["observed"][side], quality["truth"][side]
        assert found["stride_time_s"]["mean"] == pytest.approx(
            true["stride_time_s"]["mean"], abs=0.015
        )
        assert found["stride_length_m"]["mean"] == pytest.approx(
            true["stride_length_m"]["mean"], abs=0.03
        )
    assert quality["seen"]["left_knee"] > 0.9
    assert quality["d_err_m"] < 0.1
    out = capsys.readouterr().out
    tables = "Stages", "Angles and jitter", "Gait", "Parameters", "Limits"
    for words in (*tables, "back", "2 m", "1 m/s", "1 of 1", "mocap_views.png"):
        assert words in out
    (walk,) = (tmp_path / "walks").iterdir()
    assert {"truth.c3d", "refined.trc", "summary.json"} <= {file.name for file in walk.iterdir()}
    for name in ("mocap_cycles.png", "mocap_views.png"):
        assert (tmp_path / "figures" / name).read_bytes().startswith(b"\x89PNG")


WRONG = [
    ("sensor.kind=pose", ("normal, back", "seed 1", "sensor.kind")),
    ("target.path.kind=standing", ("speed_m_s",)),
    ("sim.duration_s=4.0", ("two strides", "sim.duration_s")),
]


@pytest.mark.parametrize(("setting", "words"), WRONG)
def test_what_a_user_gets_wrong_is_one_line(setting, words):
    text = error_of(MecazenError, lambda: experiment(*ONE, "--set", setting))
    for word in words:
        assert word in text
