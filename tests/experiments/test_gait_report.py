"""A recorded walk as a page beside the norm, and as files that laboratories read."""

import importlib.util
import json
import math
import warnings

import numpy as np
import pandas as pd
import pytest
from experiments.conftest import run_command
from experiments.made_up import person
from harness import error_of
from mecazen.config.people import Body
from mecazen.errors import MecazenError
from mecazen.skeleton import JOINTS
from mecazen_experiments.gait.motion import MEASURED
from mecazen_experiments.gait.report import (
    GPS,
    MARKERS,
    curves,
    norm_curve,
    trc,
    variable_scores,
    write_c3d,
)
from mecazen_experiments.gait.stages import Stage
from mecazen_experiments.gait.strides import planted, strides
from mecazen_people.body.files import read

MISSING = 3
needs_ezc3d = pytest.mark.skipif(
    importlib.util.find_spec("ezc3d") is None, reason="pip install ezc3d"
)


@pytest.fixture(scope="module")
def stage():
    """A walk in which one frame has no body."""
    t, joints, _ = person(1.0, duration_s=8.0, rate_hz=50.0)
    events = planted(t, joints)
    rows = strides(t, joints, events)
    joints = joints.copy()
    joints[MISSING] = np.nan
    return Stage(t, joints, events, rows)


def test_curves_of_equal_strides_do_not_vary(stage):
    by_place = dict([*curves(stage).groupby(["side", "joint"])])
    assert set(by_place) == {(side, joint) for side in ("left", "right") for joint in MEASURED}
    knee = by_place["left", "knee"]
    # the knee is most flexed in swing, and frames of 20 ms blur it by less than 2 deg
    assert 65 <= knee["mean_deg"].argmax() <= 80
    assert knee["sd_deg"].max() < 2.0


def test_scores_are_root_mean_squares_of_distances_from_the_norm():
    off = {"hip": 3.0, "knee": -4.0, "ankle": 12.0}
    places = [
        pd.DataFrame({"side": "left", "joint": joint, "mean_deg": norm_curve(joint) + by})
        for joint, by in off.items()
    ]
    (scores,) = variable_scores(pd.concat(places)).values()
    gps = math.sqrt((9.0 + 16.0 + 144.0) / 3.0)
    assert scores == pytest.approx({"hip": 3.0, "knee": 4.0, "ankle": 12.0, GPS: gps})
    knee = norm_curve("knee")
    assert (knee[0], knee[70], knee[100]) == pytest.approx((0.7, 59.3, 0.7))  # as in the file


@needs_ezc3d
def test_a_c3d_file_has_joints_and_events(stage, tmp_path):
    with warnings.catch_warnings(action="ignore"):  # of SWIG, on Python 3.12 and later
        import ezc3d
    late = stage.events.each(lambda times: times + 60.0)
    write_c3d(tmp_path / "walk.c3d", stage.t, stage.joints, late)
    content = ezc3d.c3d(str(tmp_path / "walk.c3d"))
    points = content["data"]["points"][:3].T / 1e3
    # floats of 32 bits hold 5 m in steps of 0.5 µm
    assert points == pytest.approx(stage.joints, abs=1e-6, nan_ok=True)
    events = content["parameters"]["EVENT"]
    minutes, seconds = events["TIMES"]["value"]
    times = np.sort(np.concatenate([*late.strikes, *late.offs])) - stage.t[0]
    assert 60.0 * minutes + seconds == pytest.approx(times, abs=1e-5)
    assert {*events["LABELS"]["value"]} == {"Foot Strike", "Foot Off"}
    assert {*events["CONTEXTS"]["value"]} == {"Left", "Right"}


@pytest.mark.parametrize("suffix", ["trc", pytest.param("c3d", marks=needs_ezc3d)])
def test_a_person_walks_a_walk_that_was_exported(stage, suffix, tmp_path):
    file = tmp_path / f"walk.{suffix}"
    if suffix == "trc":
        file.write_text(trc(file.name, stage.t, stage.joints))
    else:
        write_c3d(file, stage.t, stage.joints, None)
    assert set(MARKERS) == set(read(file).values)
    _, again, _ = person(1.0, duration_s=8.0, rate_hz=50.0, body=Body(motion_file=file))
    for name in ("head", "pelvis", "left_knee"):
        before, after = (places[:, JOINTS.index(name), 2] for places in (stage.joints, again))
        assert after.mean() == pytest.approx(np.nanmean(before), abs=0.01)
        assert after.max() == pytest.approx(np.nanmax(before), abs=0.01)


def test_a_recorded_walk_is_reported_and_exported(tmp_path, capsys):
    file = tmp_path / "run.mcap"
    run_command("simulate", "mocap", "--duration", 8, "--record", file)
    with warnings.catch_warnings(action="ignore"):  # of SWIG, on Python 3.12 and later
        run_command("gait", file, "--export", tmp_path / "walk")
    out = capsys.readouterr().out
    for words in ("Seen from: back", "Strides:", "truth", "norm, slow", "CC BY 4.0", GPS):
        assert words in out
    suffixes = ["trc", "c3d"] if importlib.util.find_spec("ezc3d") else ["trc"]
    stages = ("truth", "raw", "filtered", "refined")
    assert {file.name for file in (tmp_path / "walk").iterdir()} == {
        *(f"{name}.{suffix}" for name in stages for suffix in suffixes),
        *("strides.csv", "curves.csv", "summary.json"),
    }
    rows = pd.read_csv(tmp_path / "walk" / "strides.csv")
    assert {*rows["stage"]} == {"truth", "filtered", "refined"}
    refined = rows["speed_m_s"][rows["stage"] == "refined"].to_numpy()
    assert refined == pytest.approx(1.0, abs=0.05)
    assert len(pd.read_csv(tmp_path / "walk" / "curves.csv")) == 3 * 6 * 101
    summary = json.loads((tmp_path / "walk" / "summary.json").read_bytes())
    assert summary["view"] == "back"
    true = summary["stages"]["truth"]["parameters"]["left"]["speed_m_s"]["mean"]
    assert true == pytest.approx(1.0, abs=0.01)
    assert summary["stages"]["raw"]["parameters"] is None
    text = error_of(MecazenError, lambda: run_command("gait", file, "--export", file))
    assert "run.mcap: File exists" in text
    text = error_of(MecazenError, lambda: run_command("gait", file, "--run", 7))
    assert "no body in run 7" in text
