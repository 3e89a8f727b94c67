"""`mecazen experiment mocap`: its options, its report and its figures, of one short run."""

import math
from pathlib import Path

import msgspec
import pytest
from harness import ROOT, error_of
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_table
from mecazen_experiments.mocap import MocapConfig, configured, expand
from mecazen_tools.cli.app import app

SHORT = f"""
scenario = "{ROOT}/configs/scenarios/mocap.toml"
set = ["robot.camera.pitch_deg=22.0", "sim.duration_s=7.5"]
seeds = 1
standoffs_m = [2.0]
speeds_m_s = [1.0, 1.3]
[views]
back = 180.0
side_left = 90.0
"""
ONE = ("mocap", "short.toml", "--view", "back", "--speed", 1.0, "--jobs", 1)


@pytest.fixture
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)


def experiment(*arguments):
    app(["experiment", *map(str, arguments)], standalone_mode=False)


@pytest.mark.usefixtures("_in_folder")
def test_one_run_is_scored_printed_and_drawn(tmp_path, capsys):
    experiment(*ONE, "--json", "out.json", "--out", "figures")
    (row,) = msgspec.json.decode((tmp_path / "out.json").read_bytes())["rows"]
    labels = row["labels"]
    assert (labels["view"], labels["standoff_m"], labels["speed_m_s"]) == ("back", 2.0, 1.0)
    (run,) = row["runs"]
    quality = run["record"]["scores"]
    raw, refined = (quality["rmse_deg"][stage] for stage in ("raw", "refined"))
    for joint in ("hip", "knee", "ankle"):
        assert refined[joint] < 0.75 * raw[joint]
        assert row["means"][f"refined_{joint}_deg"]["mean"] == refined[joint]
    found, true = quality["observed"], quality["truth"]
    assert found["stride_time_s"] == pytest.approx(true["stride_time_s"], abs=0.015)
    assert found["stride_length_m"] == pytest.approx(true["stride_length_m"], abs=0.03)
    assert quality["seen"]["left_knee"] > 0.9
    assert quality["d_err_m"] < 0.1
    out = capsys.readouterr().out
    for words in ("Angles and jitter", "Gait", "back", "2 m", "1 m/s", "mocap_views.png"):
        assert words in out
    for name in ("mocap_cycles.png", "mocap_views.png"):
        assert (tmp_path / "figures" / name).read_bytes().startswith(b"\x89PNG")


WRONG = [
    (("--view", "above"), ("--view above", "back, side_left")),
    (("--set", "sensor.kind=pose"), ("back, 2 m, 1 m/s, seed 1", "sensor.kind")),
    (("--set", "target.path.kind=standing"), ("speed_m_s",)),
    (("--set", "sim.duration_s=4.0"), ("two strides", "sim.duration_s")),
    (("--json", "none/out.json"), ("none/out.json", "folder")),
    (("--out", "short.toml/figures"), ("--out short.toml/figures",)),
]


@pytest.mark.usefixtures("_in_folder")
@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_what_a_user_gets_wrong_is_one_line(arguments, words):
    text = error_of(MecazenError, lambda: experiment(*ONE, *arguments))
    for word in words:
        assert word in text


@pytest.mark.parametrize("name", ["mocap", "mocap_ideal", "mocap_standing", "mocap_gaits"])
def test_every_place_of_the_experiments_faces_the_person(name):
    config = load_table(ROOT / f"configs/experiments/{name}.toml", MocapConfig)
    todo = expand(config, None, ())
    values = config.views, config.standoffs_m, config.speeds_m_s, config.gaits
    assert len(todo) == math.prod(map(len, values))
    for series in todo:
        settings = dict(setting.split("=", 1) for setting in series.jobs[0].settings)
        bearing, heading = (float(settings[f"follower.{n}_deg"]) for n in ("bearing", "heading"))
        assert bearing == series.labels["bearing_deg"]
        assert (heading - bearing) % 360.0 == pytest.approx(180.0)
        assert f"yaw_deg = {heading}" in settings["start"]


@pytest.mark.usefixtures("_in_folder")
def test_options_replace_what_the_experiment_has():
    config = load_table(Path("short.toml"), MocapConfig)
    assert configured("short.toml", (), (), ()) == config
    some = configured("short.toml", ["back"], [1.2], [0.8])
    assert (some.views, some.standoffs_m, some.speeds_m_s) == ({"back": 180.0}, (1.2,), (0.8,))
    with pytest.raises(ConfigError, match="above"):
        configured("short.toml", ["above"], (), ())
