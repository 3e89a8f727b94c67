"""Curves over the gait cycle, their distance from the norm, and files with both."""

import csv
import json
import math

import numpy as np
import pytest
from experiments.walks import person
from mecazen.errors import MecazenError
from mecazen_experiments.gait.curves import Curve, curves, norm, variable_scores
from mecazen_experiments.gait.events import planted
from mecazen_experiments.gait.export import export
from mecazen_experiments.gait.parameters import strides
from mecazen_experiments.gait.stages import Stage


@pytest.fixture(scope="module")
def stage():
    t, joints, _ = person(1.0, duration_s=8.0, rate_hz=50.0)
    events = planted(t, joints)
    return Stage(t, joints, events, tuple(strides(t, joints, events)))


def test_the_norm_s_curves_pass_through_its_values_and_end_where_they_begin():
    of = norm().curves
    knee = of.at_all(of.deg["knee"])
    assert (knee[0], knee[70], knee[100]) == pytest.approx((0.7, 59.3, 0.7))
    assert norm().nearest(1.1).name == "comfortable"


def test_curves_of_equal_strides_do_not_vary(stage):
    found = curves(stage)
    assert set(found) == {(s, j) for s in ("left", "right") for j in ("hip", "knee", "ankle")}
    knee = found["left", "knee"]
    assert knee.mean.shape == (101,)
    # the knee is most flexed in swing, and frames of 20 ms blur it by less than 2 deg
    assert 65 <= np.argmax(knee.mean) <= 80
    assert knee.sd.max() < 2.0


def test_scores_are_root_mean_squares_of_distances_from_the_norm():
    of = norm().curves
    off = {"hip": 3.0, "knee": -4.0, "ankle": 12.0}
    found = {
        ("left", joint): Curve(of.at_all(of.deg[joint]) + by, np.zeros(101), 1)
        for joint, by in off.items()
    }
    (scores,) = variable_scores(found).values()
    assert (scores.hip, scores.knee, scores.ankle) == pytest.approx((3.0, 4.0, 12.0))
    assert scores.sagittal_gps == pytest.approx(math.sqrt((9.0 + 16.0 + 144.0) / 3.0))


def test_an_export_has_all_files_of_all_stages(stage, tmp_path):
    gap = stage.joints.copy()
    gap[5] = np.nan
    raw = Stage(stage.t, gap, stage.events)
    files = export(tmp_path / "walk", {"truth": stage, "raw": raw}, {"view": "back"})
    assert {file.name for file in files} == {
        *(f"{name}.{suffix}" for name in ("truth", "raw") for suffix in ("trc", "mot", "c3d")),
        *("strides.csv", "curves.csv", "summary.json"),
    }
    with (tmp_path / "walk" / "strides.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["side"] for row in rows] == [stride.side for stride in stage.strides]
    assert float(rows[0]["stride_time_s"]) == stage.strides[0].stride_time_s
    with (tmp_path / "walk" / "curves.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 6 * 101
    summary = json.loads((tmp_path / "walk" / "summary.json").read_bytes())
    assert summary["view"] == "back"
    true = summary["stages"]["truth"]
    assert true["parameters"]["speed_m_s"]["left"]["mean"] == pytest.approx(1.0, abs=0.01)
    assert "sagittal GPS (3 of 9 variables)" in true["gait_variable_scores_deg"]["left"]
    assert summary["stages"]["raw"]["parameters"] is None
    # OpenSim stops reading coordinates at the first `nan`: such frames are left out
    assert f"nRows={len(stage.t) - 1}" in (tmp_path / "walk" / "raw.mot").read_text()


def test_a_folder_that_can_not_be_made_is_one_line(stage, tmp_path):
    (tmp_path / "walk").write_text("")
    with pytest.raises(MecazenError, match=r"--export .*walk: File exists"):
        export(tmp_path / "walk", {"truth": stage}, {})
