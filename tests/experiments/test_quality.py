"""Quality of a captured walk, where errors are known, and one short run of the study."""

import math
from pathlib import Path

import numpy as np
import pytest
from experiments.conftest import experiment
from experiments.made_up import BACK, run
from experiments.walks import person, reported
from harness import ROOT
from mecazen.errors import ConfigError, MecazenError
from mecazen.skeleton import ANGLES, JOINTS
from mecazen_experiments.capture import Capture
from mecazen_experiments.figures import PERCENT, by_stride
from mecazen_experiments.quality import MEASURED, SETTLING_S, quality, walk_of

WALKED_S = 12.0


def captured(joints, truth, t, phases, seen=2):
    """A capture of a person who walks from the first tick on."""
    true = reported(t, truth, 0.0)._replace(phases=phases)
    confidence = np.full(joints.shape[:2], seen)
    ticks = round(WALKED_S / 0.01)
    x = 1.2 * 0.01 * np.arange(ticks)
    pose = {"target": (x, 0.0, 0.0), "robot": (x - 1.0, 0.0, 0.0)}
    table = run(ticks, **pose, odom=pose["robot"])
    return Capture(true, reported(t, joints)._replace(confidence=confidence), table, "sha")


@pytest.fixture(scope="module")
def walk():
    return person(duration_s=WALKED_S)


def test_without_noise_nothing_is_wrong(walk):
    t, joints, phases = walk
    found = captured(joints, joints, t, phases)
    columns = quality(found, BACK)
    assert [columns[f"raw_{joint}_deg"] for joint in MEASURED] == [0.0] * 3
    assert columns["knee_seen_percent"] == 100.0
    assert abs(columns["speed_err_percent"]) < 1.0
    assert abs(columns["stride_length_err_mm"]) < 20.0
    angles = walk_of(found).angles
    assert angles["raw"] == pytest.approx(angles["truth"])
    assert len(angles["raw"]) == (t >= SETTLING_S).sum()


def test_a_constant_error_of_one_leg_is_gone_when_centred(walk):
    t, joints, phases = walk
    turned = joints.copy()
    turned[:, JOINTS.index("left_ankle"), 2] += 0.05
    found = captured(turned, joints, t, phases, seen=1)
    columns, angles = quality(found, BACK), walk_of(found).angles
    errors = (angles["raw"] - angles["truth"])[:, ANGLES.index("left_ankle")]
    # the right leg has no error
    assert columns["raw_ankle_deg"] == pytest.approx(math.sqrt((errors**2).mean() / 2.0))
    assert columns["raw_ankle_centred_deg"] == pytest.approx(math.sqrt(errors.var() / 2.0))
    assert columns["knee_seen_percent"] == 0.0


def test_a_person_who_stands_has_no_gait(walk):
    t, joints, phases = walk
    still = np.broadcast_to(joints[0], joints.shape)
    with pytest.raises(ConfigError, match="nobody takes two strides"):
        quality(captured(still, still, t, phases), BACK)


def test_a_walk_that_no_frame_shows_has_the_same_columns_without_values(walk):
    t, joints, phases = walk
    columns = quality(captured(np.full_like(joints, np.nan), joints, t, phases), BACK)
    assert columns.keys() == quality(captured(joints, joints, t, phases), BACK).keys()
    for name in ("raw_knee_deg", "refined_knee_deg", "strike_err_ms", "raw_jitter_mm"):
        assert columns[name] is None


def test_strides_of_both_legs_are_drawn_from_strike_to_strike():
    progress = np.linspace(0.3, 3.2, 200)
    phases = np.stack((progress % 1.0, (progress + 0.5) % 1.0), axis=-1)
    angle = np.sin(2.0 * np.pi * phases)
    angle[::7] = np.nan
    strides = by_stride(phases, angle)
    assert strides.shape == (4, len(PERCENT))  # two of each leg
    # linear interpolation over gaps of two samples
    assert strides == pytest.approx(
        np.tile(np.sin(2.0 * np.pi * PERCENT / 100.0), (4, 1)), abs=0.01
    )


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
[[figure]]
name = "cycles"
kind = "cycles"
"""


def test_a_run_is_measured_and_its_cycles_are_drawn(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder.path)
    folder.write("study.toml", SHORT)
    experiment("run", "study.toml", "--jobs", 1, "--csv", "out.csv", "--figures", "figures")
    (row,) = folder.runs("out.csv")
    for joint in MEASURED:
        assert float(row[f"refined_{joint}_deg"]) < 0.75 * float(row[f"raw_{joint}_deg"])
    assert float(row["stride_time_err_ms"]) < 15.0
    assert float(row["stride_length_err_mm"]) < 30.0
    assert float(row["knee_seen_percent"]) > 90.0
    assert "refined" in capsys.readouterr().out
    assert Path("figures/cycles.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("setting", "words"),
    [("sensor.kind=pose", "normal, seed 1.*sensor.kind"), ("sim.duration_s=4.0", "two strides")],
)
def test_a_run_that_can_t_be_measured_is_one_line(folder, monkeypatch, setting, words):
    monkeypatch.chdir(folder.path)
    folder.write("study.toml", SHORT)
    with pytest.raises(MecazenError, match=words):
        experiment("run", "study.toml", "--jobs", 1, "--set", setting)
